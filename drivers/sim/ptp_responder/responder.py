"""The simulated camera without any I/O: containers in, containers out."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.clock import SystemClock
from drivers.protocols import Clock
from drivers.ptp.codes import ContainerType, ResponseCode
from drivers.ptp.cursor import PropertyValue
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.wire import MAX_PARAMETERS, Bytes, Container
from drivers.sim.ptp_responder import nikon, standard
from drivers.sim.ptp_responder.answer import Answer, Cut, Output, Raw, RefusalError, Stall, Unplug
from drivers.sim.ptp_responder.body import Body, d4s
from drivers.sim.ptp_responder.camera import SimulatedBody
from drivers.sim.ptp_responder.misbehaviour import OF_A_SHOT, Misbehaviour, Name, Script
from drivers.sim.ptp_responder.source import Developer, ImageSource, NoDeveloper

CARD_IMAGES = 999

_HANDLERS = {**standard.HANDLERS, **nikon.HANDLERS}
_GARBAGE = bytes.fromhex("deadbeef") * 16
_OLD_TRANSACTION = 0x1234  # of a program that was killed


class Responder:
    """A simulated camera in the responder's role.

    Parameters
    ----------
    source
        Its pictures.
    model
        Which body; a Nikon D4S when None.
    misbehaviours
        What it does wrong.
    clock
        Its time; the host's when None.
    card_images
        That its card holds; 0 for no card.
    autofocus_finds
        Whether there is anything for the autofocus to hold on to.
    developer
        What makes JPEGs of its raw files; None where none are asked for.
    """

    def __init__(
        self,
        source: ImageSource,
        model: Body | None = None,
        misbehaviours: Sequence[Misbehaviour] = (),
        clock: Clock | None = None,
        card_images: int = CARD_IMAGES,
        autofocus_finds: bool = True,
        developer: Developer | None = None,
    ) -> None:
        self._body = SimulatedBody(
            d4s() if model is None else model,
            source,
            NoDeveloper() if developer is None else developer,
            SystemClock() if clock is None else clock,
            card_images,
            autofocus_finds,
        )
        self._script = Script(misbehaviours)
        self._waiting: Container | None = None
        self._asleep = False

    @property
    def is_remote(self) -> bool:
        """Whether a computer has taken control of the body."""
        return self._body.is_remote

    @property
    def is_open(self) -> bool:
        """Whether a session is open."""
        return bool(self._body.session)

    @property
    def untaken(self) -> tuple[Misbehaviour, ...]:
        """Misbehaviours that nothing has called for yet."""
        return self._script.untaken

    def turn(self, code: int, value: PropertyValue) -> None:
        """Set a property on the body itself, as a person does with its wheels and levers."""
        self._body.properties.turn(code, value)

    def handle(self, container: Container) -> list[Output]:
        """What goes to the host in answer to one container of it.

        A command whose data are to follow is answered after them.
        """
        if self._asleep:
            return []
        if container.kind is ContainerType.COMMAND:
            if container.code in standard.TAKES_DATA:
                self._waiting = container
                return []
            return self._run(container, b"")
        command, self._waiting = self._waiting, None
        if command is None or container.transaction != command.transaction:
            return []
        return self._run(command, container.payload)

    def due_events(self) -> list[Container]:
        """Events that are sent by themselves, by now; to be asked for again and again."""
        if self._asleep:
            return []
        self._body.advance()
        events, self._body.shutter.pushed[:] = list(self._body.shutter.pushed), []
        return [
            Container.with_parameters(ContainerType.EVENT, event.code, 0, event.parameters)
            for event in events
        ]

    def reset(self) -> None:
        """The transport was reset or the host is gone: no session, awake."""
        self._body.leave()
        self._waiting = None
        self._asleep = False

    def _run(self, command: Container, data: Bytes) -> list[Output]:
        self._body.advance()
        wrong = self._script.take(command.code)
        if wrong is None or wrong.name in OF_A_SHOT:
            self._body.event_fault = None if wrong is None else wrong.name
            return [*_containers(command, self._answer(command, data))]
        return self._misbehave(wrong, command, data)

    def _misbehave(self, wrong: Misbehaviour, command: Container, data: Bytes) -> list[Output]:
        """What goes to the host instead of the answer, or around it."""
        self._body.event_fault = None
        instead = self._refuse_to_work(wrong, command)
        if instead is not None:
            return instead
        containers = _containers(command, self._answer(command, data))
        outputs: dict[Name, list[Output]] = {
            Name.TIMEOUT: [],
            Name.WRONG_TRANSACTION: [_renumbered(c, command.transaction + 1) for c in containers],
            Name.STALE_ANSWER: [_renumbered(containers[-1], _OLD_TRANSACTION), *containers],
            Name.CUT_OBJECT: [*_cut(containers), containers[-1]],
            Name.UNPLUG: [*_cut(containers), Unplug()],
        }
        return outputs[wrong.name]

    def _refuse_to_work(self, wrong: Misbehaviour, command: Container) -> list[Output] | None:
        """What goes to the host when the operation is not even begun; None when it is."""
        match wrong.name:
            case Name.BUSY:
                return [*_containers(command, Answer(wrong.code))]
            case Name.STALL:
                return [Stall()]
            case Name.GARBAGE:
                return [Raw(_GARBAGE)]
            case Name.SLEEP:
                self._asleep = True
                return []
            case _:
                return None

    def _answer(self, command: Container, data: Bytes) -> Answer:
        body = self._body
        if command.code not in body.model.info.operations or command.code not in _HANDLERS:
            return Answer(ResponseCode.OPERATION_NOT_SUPPORTED)
        if not body.session and command.code not in standard.WITHOUT_SESSION:
            return Answer(ResponseCode.SESSION_NOT_OPEN)
        try:
            given = command.parameters
        except PtpProtocolError:
            return Answer(ResponseCode.PARAMETER_NOT_SUPPORTED)
        parameters = given + (0,) * (MAX_PARAMETERS - len(given))
        try:
            return _HANDLERS[command.code](standard.Call(body, parameters, data))
        except RefusalError as refusal:
            return Answer(refusal.code)


def _containers(command: Container, answer: Answer) -> list[Container]:
    response = Container.with_parameters(
        ContainerType.RESPONSE, answer.code, command.transaction, answer.parameters
    )
    if answer.data is None:
        return [response]
    return [Container(ContainerType.DATA, command.code, command.transaction, answer.data), response]


def _renumbered(container: Container, transaction: int) -> Container:
    return Container(container.kind, container.code, transaction, container.payload)


def _cut(containers: Sequence[Container]) -> list[Output]:
    """Half of the data, where there are any."""
    return [Cut(each, len(each.payload) // 2) for each in containers[:-1]]
