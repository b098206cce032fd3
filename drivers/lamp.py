"""The projector's lamp and inputs, over its RS-232 port."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from drivers.errors import ProjectorError, SerialError
from drivers.lamp_commands import COMMAND_SETS, LampState, Verdict
from drivers.protocols import Clock
from drivers.serial_line import SerialLine

__all__ = ["LampControl", "LampState", "LampTiming"]

MAX_DOUBTS = 5


@dataclass(frozen=True, slots=True)
class LampTiming:
    """How patient to be with a projector, in seconds.

    Parameters
    ----------
    answer_s
        For an answer, before the command is sent again. PJLink allows a projector 2 s.
    poll_s
        Between two questions after the state of the lamp.
    warm_up_s
        From the lamp reported on to its light steady; brightness drifts for minutes.
    on_limit_s, off_limit_s
        For the lamp to come on, and to cool down.
    """

    answer_s: float = 2.0
    poll_s: float = 1.0
    warm_up_s: float = 0.0
    on_limit_s: float = 180.0
    off_limit_s: float = 300.0


class LampControl:
    """Turns the lamp on and off and selects what is projected.

    Parameters
    ----------
    port
        Serial port that the projector hangs on.
    commands
        Name of its command set, a key of `drivers.lamp_commands.COMMAND_SETS`.
    timing
        How patient to be.
    clock
        The bench's clock, for the waits between questions.
    baud
        Rate that the projector is set to; None for its maker's.
    """

    def __init__(
        self, port: str, commands: str, timing: LampTiming, clock: Clock, baud: int | None = None
    ) -> None:
        if commands not in COMMAND_SETS:
            raise ValueError(f"{commands!r} is no command set; known: {', '.join(COMMAND_SETS)}")
        self._commands, self._timing, self._clock = COMMAND_SETS[commands], timing, clock
        self._line = SerialLine(port, baud or self._commands.baud)
        self._wanted = LampState.OFF

    def state(self) -> LampState:
        """What the lamp does now."""
        answer = self._confirmed_state()
        if isinstance(answer, LampState):
            return answer
        if answer is Verdict.BUSY:
            # It neither says nor takes anything only on the way to what was last asked of it.
            return LampState.WARMING if self._wanted is LampState.ON else LampState.COOLING
        raise ProjectorError(self._refusal("say what its lamp does", answer))

    def power_on(self) -> None:
        """Turn the lamp on and wait until its light is steady.

        A lamp that still cools down is waited for first.

        Raises
        ------
        ProjectorError
            It did not come on in time.
        SerialError
            The projector does not answer.
        """
        if self.state() is LampState.ON:
            return
        self._reach(LampState.ON, self._timing.on_limit_s + self._timing.off_limit_s)
        self._clock.sleep(self._timing.warm_up_s)

    def power_off(self) -> None:
        """Turn the lamp off and wait until it has cooled down; raises as `power_on`."""
        self._reach(LampState.OFF, self._timing.off_limit_s + self._timing.on_limit_s)

    def select_input(self, name: str) -> None:
        """Project an input: ``31`` (PJLink: digital 1), ``hdmi`` (BenQ)."""
        answer = self._insist(self._commands.select_input(name))
        if answer is not Verdict.DONE:
            raise ProjectorError(self._refusal(f"select the input {name!r}", answer))

    def unfreeze(self) -> bool:
        """Let the picture follow the input; False where the projector has no such command."""
        answer = self._insist(self._commands.unfreeze)
        if answer not in {Verdict.DONE, Verdict.UNKNOWN}:
            raise ProjectorError(self._refusal("unfreeze its picture", answer))
        return answer is Verdict.DONE

    def close(self) -> None:
        """Close the port; the lamp stays as it is."""
        self._line.close()

    def _reach(self, wanted: LampState, limit_s: float) -> None:
        resting = LampState.OFF if wanted is LampState.ON else LampState.ON
        deadline_s = self._clock.monotonic() + limit_s
        while (state := self.state()) is not wanted:
            if self._clock.monotonic() >= deadline_s:
                raise ProjectorError(
                    f"The projector's lamp is still {state} after {limit_s:.0f} s; it was to be "
                    f"{wanted}. Look at its lamp and temperature lights and at its lamp hours."
                )
            if state is resting:
                self._wanted = wanted
                answer = self._ask(self._commands.power(wanted))
                if answer not in {Verdict.DONE, Verdict.BUSY}:
                    raise ProjectorError(self._refusal(f"turn {wanted}", answer))
            self._clock.sleep(self._timing.poll_s)

    def _confirmed_state(self) -> LampState | Verdict:
        """The same answer twice running: none has a check sum, and noise can turn off into on."""
        answer = self._ask(self._commands.power_query)
        for _ in range(MAX_DOUBTS):
            before, answer = answer, self._ask(self._commands.power_query)
            if answer is before:
                return answer
        raise SerialError(
            f"The projector on {self._line.port} contradicts itself about its lamp: the line is "
            "too noisy. Use a shorter, shielded cable, away from power cables."
        )

    def _insist(self, request: bytes) -> LampState | Verdict:
        """The answer once the projector is no longer busy."""
        deadline_s = self._clock.monotonic() + self._timing.on_limit_s
        while True:
            answer = self._ask(request)
            if answer is not Verdict.BUSY or self._clock.monotonic() >= deadline_s:
                return answer
            self._clock.sleep(self._timing.poll_s)

    def _ask(self, request: bytes) -> LampState | Verdict:
        commands = self._commands
        answer = self._line.ask(
            request, commands.end, lambda line: commands.read(request, line), self._timing.answer_s
        )
        return cast("LampState | Verdict", answer)  # mypy joins the two to StrEnum

    def _refusal(self, deed: str, answer: LampState | Verdict) -> str:
        return (
            f"The projector on {self._line.port} would not {deed}: {answer.value}. Check that the "
            "bench file names its command set and one of its inputs, and that it shows no fault."
        )
