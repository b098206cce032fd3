"""The host's end of a USB still image interface, without I/O."""

from __future__ import annotations

from drivers.ptp.codes import UNDEFINED_LENGTH, ContainerType
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.transaction import Conversation, Event, Part, Request, State, Step, Stray
from drivers.ptp.wire import HEADER_BYTES, Bytes, Container, Header

_STEPS = {
    (State.ASKED, ContainerType.DATA): Step.BEGIN_DATA,
    (State.ASKED, ContainerType.RESPONSE): Step.ANSWER,
    (State.DATA_OVER, ContainerType.RESPONSE): Step.ANSWER,
}


class UsbInitiator(Conversation):
    """The host's end of a USB still image interface."""

    def __init__(self) -> None:
        super().__init__()
        self._head = bytearray()
        self._part = Part.HEAD
        self._left: int | None = 0  # of the data of this container; None: until a short packet
        self._passed = 0
        self._interrupts = bytearray()

    def send(self, request: Request, into: bytearray | memoryview | None = None) -> list[bytes]:
        """The bulk transfers that start a transaction, in order.

        Parameters
        ----------
        request
            What is asked.
        into
            Where the camera's data go; more data than it holds are an error. None: they come as
            `DataChunk`.
        """
        self._begin(request, into)
        number = self._transaction
        command = Container.with_parameters(
            ContainerType.COMMAND, request.code, number, request.parameters
        )
        if request.data is None:
            return [command.encode()]
        data = Container(ContainerType.DATA, request.code, number, request.data)
        return [command.encode(), data.encode()]

    def receive_data(self, data: Bytes, ended: bool = False) -> None:
        """Bytes of the bulk-in endpoint, in pieces of any size.

        Parameters
        ----------
        data
            The bytes; may be empty.
        ended
            A short or an empty packet ended the transfer with them. Needed where the length of
            the data is undefined or a lie; harmless otherwise.
        """
        self._check()
        view = memoryview(data).cast("B")
        while view:
            view = self._take_head(view) if self._part is Part.HEAD else self._take_data(view)
        if ended:
            self._end_transfer()

    def writable(self, multiple: int = 1) -> memoryview | None:
        """Where the next bytes of the bulk-in endpoint may be read to directly.

        Parameters
        ----------
        multiple
            Size of the endpoint's packets in bytes: the piece offered is a multiple of it.

        Returns
        -------
        A piece of the caller's buffer, or None: then use `receive_data`.
        """
        if self._part is not Part.DATA or self._left is None:
            return None
        return self._window(self._left, multiple)

    def wrote(self, count: int, ended: bool = False) -> None:
        """`count` bytes were read into what `writable` offered."""
        if self._left is None or self._part is not Part.DATA or not 0 <= count <= self._left:
            raise ValueError(f"{count} bytes written where {self._left} are due")
        self._size += count
        self._pass(count)
        if ended:
            self._end_transfer()

    def receive_event(self, data: Bytes) -> None:
        """Bytes of the interrupt endpoint, in pieces of any size.

        What is no event is forgotten and raises once; the transaction under way goes on.
        """
        self._interrupts += data
        while len(self._interrupts) >= HEADER_BYTES:
            try:
                header = Header.decode(self._interrupts[:HEADER_BYTES])
                if header.kind is not ContainerType.EVENT:
                    raise PtpProtocolError(f"a {header.kind.name.lower()} among the events")
            except PtpProtocolError:
                self._interrupts.clear()
                raise
            if len(self._interrupts) < header.length:
                return
            event = Container.decode(self._interrupts[: header.length])
            del self._interrupts[: header.length]
            self._events.append(Event(event.code, event.parameters))

    def reset(self) -> None:
        """Forget the transaction under way and all bytes; numbers go on."""
        self._forget()
        self._head.clear()
        self._interrupts.clear()
        self._part = Part.HEAD

    def _take_head(self, view: memoryview) -> memoryview:
        """Gather a header, and the parameters where it has any."""
        due = HEADER_BYTES
        if len(self._head) >= HEADER_BYTES:
            due = int.from_bytes(self._head[:4], "little")
        count = due - len(self._head)
        self._head += view[:count]
        if len(self._head) == HEADER_BYTES == due:
            header = self._decode_header()
            if header.kind is ContainerType.DATA:
                self._head.clear()
                self._begin_container(header)
            elif header.length == HEADER_BYTES:
                self._finish_container()
        elif len(self._head) == due:
            self._finish_container()
        return view[count:]

    def _decode_header(self) -> Header:
        try:
            return Header.decode(self._head)
        except PtpProtocolError as error:
            self._fail(str(error))

    def _begin_container(self, header: Header) -> None:
        """A data container: the transaction's own or another's."""
        undefined = header.length == UNDEFINED_LENGTH
        self._left = None if undefined else header.length - HEADER_BYTES
        self._passed = 0
        if self._is_own(header.transaction) and header.code == self._code:
            if _STEPS.get((self._state, header.kind)) is not Step.BEGIN_DATA:
                self._fail("the camera sent data twice in one transaction")
            self._part = Part.DATA
            self._start_data(self._left)
        else:
            self._part = Part.SKIPPED
            self._events.append(Stray(header.code, header.transaction))
        self._pass(0)

    def _finish_container(self) -> None:
        container = Container.decode(self._head)
        self._head.clear()
        if container.kind is ContainerType.EVENT:
            self._events.append(Event(container.code, container.parameters))
        elif container.kind is ContainerType.COMMAND:
            self._fail("the camera sent a command")
        elif self._is_own(container.transaction):
            self._answer(container.code, container.parameters)
        else:
            self._events.append(Stray(container.code, container.transaction))

    def _take_data(self, view: memoryview) -> memoryview:
        count = len(view) if self._left is None else min(self._left, len(view))
        if self._part is Part.DATA:
            self._take(view[:count])
        self._pass(count)
        return view[count:]

    def _pass(self, count: int) -> None:
        """`count` bytes of the container's data are behind us."""
        self._passed += count
        if self._left is not None:
            self._left -= count
            if not self._left:
                self._close_container()

    def _close_container(self) -> None:
        if self._part is Part.DATA:
            self._end_data()
        self._part = Part.HEAD

    def _end_transfer(self) -> None:
        if self._part is Part.HEAD:
            if self._head:
                self._fail(f"a transfer ended after {len(self._head)} bytes of a container")
        elif self._passed:
            self._close_container()
        # A header that travels alone ends its transfer as well; the data are still to come.
