"""PTP over USB with pyusb and libusb, which only this module and `usb_port` know.

After the USB Still Image Capture Device definition 1.0: one interface of class 6/1/1 with a bulk
pipe each way and an interrupt pipe for events, and three class requests on the control pipe.
"""

from __future__ import annotations

import array
import contextlib
import errno
import struct
import time
from typing import Any, NoReturn

import usb.core
import usb.util

from drivers.clock import SystemClock
from drivers.errors import CameraError
from drivers.protocols import Clock
from drivers.ptp import usb_advice
from drivers.ptp.codes import ClassRequest, EventCode, ResponseCode
from drivers.ptp.errors import (
    PtpDisconnectedError,
    PtpProtocolError,
    PtpStalledError,
    PtpTimeoutError,
    PtpTransportError,
)
from drivers.ptp.transaction import Happening, NeedData, Request
from drivers.ptp.usb_initiator import UsbInitiator
from drivers.ptp.usb_port import UsbPort

# A multiple of every packet size (64, 512, 1024); larger gains nothing on USB 3.
READ_BYTES = 1 << 20
WRITE_TIMEOUT_S = 5.0
CONTROL_TIMEOUT_S = 2.0
AFTER_HALT_TIMEOUT_S = 0.5
DRAIN_TIMEOUT_S = 0.1
DRAIN_READS = 64
MAX_EMPTY_READS = 16
RESET_POLLS = 20
RESET_POLL_S = 0.1
CLAIM_TRIES = 4
CLAIM_PAUSE_S = 0.5
UNPLUG_PAUSE_S = 0.5
_CLASS_OUT, _CLASS_IN, _STANDARD_IN = 0x21, 0xA1, 0x80
_GONE = frozenset({errno.ENODEV, errno.ENXIO, errno.ESHUTDOWN, errno.ENOENT})


class UsbLink:
    """A claimed still image interface (see `drivers.ptp.link.Link`).

    Parameters
    ----------
    port
        Where the camera is.
    clock
        For the pauses between tries to claim it.
    """

    def __init__(self, port: UsbPort, clock: Clock | None = None) -> None:
        self._port = port
        self._device = port.device
        self._clock = SystemClock() if clock is None else clock
        self._initiator = UsbInitiator()
        self._buffer = array.array("B", bytes(READ_BYTES))
        self._open = True
        try:
            self._claim()
        except BaseException:
            self.close()
            raise

    def send(self, request: Request, into: memoryview | None = None) -> None:
        """Begin a transaction."""
        for block in self._initiator.send(request, into):
            self._write(block)

    def receive(self, timeout_s: float) -> Happening:
        """What comes next."""
        empty_reads = 0
        while isinstance(happening := self._initiator.next_event(), NeedData):
            data, ended = self._read(timeout_s)
            self._initiator.receive_data(data, ended)
            empty_reads = 0 if data else empty_reads + 1
            if empty_reads > MAX_EMPTY_READS:
                raise PtpProtocolError("the camera sends empty packets only; switch it off and on")
        return happening

    def take(self) -> Happening:
        """What has been taken in already."""
        return self._initiator.next_event()

    def poll_events(self, timeout_s: float) -> None:
        """Read the interrupt pipe once."""
        if self._port.interrupt_in is None:
            self._clock.sleep(timeout_s)
            return
        buffer = array.array("B", bytes(self._port.event_bytes))
        try:
            count = self._device.read(self._port.interrupt_in, buffer, _milliseconds(timeout_s))
        except usb.core.USBTimeoutError:
            return
        except usb.core.USBError as error:
            if error.errno == errno.EPIPE:
                self._clear_halt(self._port.interrupt_in)
                return
            self._fail(error)
        with contextlib.suppress(PtpProtocolError):  # an odd event is no reason to lose a shot
            self._initiator.receive_event(memoryview(buffer)[:count])

    def recover(self) -> None:
        """Give up the transaction under way, empty the pipe, reset the interface."""
        with contextlib.suppress(PtpTransportError):
            cancel = struct.pack("<HI", EventCode.CANCEL_TRANSACTION, self._initiator.transaction)
            self._control(_CLASS_OUT, ClassRequest.CANCEL, cancel)
        self._drain()
        with contextlib.suppress(PtpStalledError, PtpTimeoutError):
            self._control(_CLASS_OUT, ClassRequest.DEVICE_RESET, b"")
        self._wait_until_ready()
        for endpoint in (self._port.bulk_in, self._port.bulk_out):
            with contextlib.suppress(PtpStalledError):
                self._clear_halt(endpoint)
        self._drain()
        self._initiator.reset()

    def close(self) -> None:
        """Release the interface; may be called more than once."""
        if not self._open:
            return
        self._open = False
        with contextlib.suppress(usb.core.USBError, NotImplementedError):
            usb.util.release_interface(self._device, self._port.interface)
        with contextlib.suppress(usb.core.USBError, NotImplementedError):
            usb.util.dispose_resources(self._device)

    def _claim(self) -> None:
        """Open the device and claim its interface; a busy one is tried again a few times."""
        port = self._port
        for left in reversed(range(CLAIM_TRIES)):
            try:
                self._configure()
                usb.util.claim_interface(self._device, port.interface)
            except NotImplementedError as error:
                raise CameraError(usb_advice.unsupported(port.vendor, port.product)) from error
            except usb.core.USBError as error:
                if error.errno in {errno.EACCES, errno.EPERM}:
                    raise CameraError(usb_advice.denied(port.vendor, port.product)) from error
                if error.errno != errno.EBUSY:
                    self._fail(error)
                if not left:
                    raise CameraError(usb_advice.busy(port.bus, port.address)) from error
                usb.util.dispose_resources(self._device)
                self._clock.sleep(CLAIM_PAUSE_S)
            else:
                return

    def _configure(self) -> None:
        """Choose the configuration only where none is: choosing it again resets the device."""
        try:
            self._device.get_active_configuration()
        except usb.core.USBError as error:
            if error.errno is not None:
                raise
            self._device.set_configuration()

    def _read(self, timeout_s: float) -> tuple[memoryview, bool]:
        """Bytes of the bulk pipe and whether a short packet ended them.

        A read that fills no buffer has met a short packet, unless its time ran out at the edge
        of a packet.
        """
        started_s = time.monotonic()
        try:
            count = self._bulk_in(timeout_s)
        except PtpStalledError:
            count = self._bulk_in_after_halt()
        at_edge = count > 0 and count % self._port.packet_bytes == 0
        ran_out = time.monotonic() - started_s >= timeout_s
        ended = count < READ_BYTES and not (at_edge and ran_out)
        return memoryview(self._buffer)[:count], ended

    def _bulk_in_after_halt(self) -> int:
        """Read again; a device that halts and then says nothing has dropped the transaction."""
        self._clear_halt(self._port.bulk_in)
        try:
            return self._bulk_in(AFTER_HALT_TIMEOUT_S)
        except PtpTimeoutError as error:
            self._initiator.reset()
            raise PtpStalledError(
                "the camera halted its USB pipe and gave no answer; try again"
            ) from error

    def _bulk_in(self, timeout_s: float) -> int:
        try:
            count: int = self._device.read(
                self._port.bulk_in, self._buffer, _milliseconds(timeout_s)
            )
        except usb.core.USBError as error:
            self._fail(error)
        return count

    def _write(self, block: bytes) -> None:
        """One bulk transfer; an empty packet follows one that fills its last packet."""
        try:
            self._bulk_out(block)
        except PtpStalledError:
            self._clear_halt(self._port.bulk_out)
            self._bulk_out(block)
        if len(block) % self._port.packet_bytes == 0:
            self._bulk_out(b"")

    def _bulk_out(self, block: bytes) -> None:
        try:
            count = self._device.write(self._port.bulk_out, block, _milliseconds(WRITE_TIMEOUT_S))
        except usb.core.USBError as error:
            self._fail(error)
        if count != len(block):
            raise PtpTimeoutError(f"the camera took {count} of {len(block)} bytes and no more")

    def _drain(self) -> None:
        """Read what is left of another transaction, for as long as anything comes."""
        for _ in range(DRAIN_READS):
            try:
                self._bulk_in(DRAIN_TIMEOUT_S)
            except PtpTimeoutError:
                return
            except PtpStalledError:
                self._clear_halt(self._port.bulk_in)
        raise PtpProtocolError(
            "the camera does not stop sending data that nobody asked for; switch it off and on"
        )

    def _wait_until_ready(self) -> None:
        """Ask for the device's status until it is no longer busy; cameras may not know it."""
        for _ in range(RESET_POLLS):
            try:
                status = self._control(_CLASS_IN, ClassRequest.GET_DEVICE_STATUS, 32)
            except (PtpStalledError, PtpTimeoutError):
                return
            if int.from_bytes(status[2:4], "little") != ResponseCode.DEVICE_BUSY:
                return
            self._clock.sleep(RESET_POLL_S)

    def _control(self, kind: int, request: int, data: bytes | int) -> bytes:
        try:
            answer = self._device.ctrl_transfer(
                kind, request, 0, self._port.interface, data, _milliseconds(CONTROL_TIMEOUT_S)
            )
        except usb.core.USBError as error:
            self._fail(error)
        return bytes(answer) if isinstance(data, int) else b""

    def _clear_halt(self, endpoint: int) -> None:
        try:
            self._device.clear_halt(endpoint)
        except usb.core.USBError as error:
            self._fail(error)

    def _is_gone(self) -> bool:
        """Whether the device is off the bus; the kernel needs a moment to notice.

        Until then a pulled cable looks like a bad one (EIO).
        """
        self._clock.sleep(UNPLUG_PAUSE_S)
        try:
            self._device.ctrl_transfer(_STANDARD_IN, 0, 0, 0, 2, _milliseconds(CONTROL_TIMEOUT_S))
        except usb.core.USBError as error:
            return error.errno in _GONE
        return False

    def _fail(self, error: Any) -> NoReturn:
        """Say a failure of pyusb in this package's words."""
        if isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT:
            raise PtpTimeoutError(
                "the camera on the USB does not answer; if it stays silent, switch it off and on"
            ) from error
        if error.errno == errno.EPIPE:
            raise PtpStalledError("the camera halted its USB pipe; reset it") from error
        if error.errno in _GONE or self._is_gone():
            raise PtpDisconnectedError(usb_advice.gone()) from error
        raise PtpTransportError(
            f"the USB transfer failed ({error}); check cable and hub"
        ) from error


def _milliseconds(duration_s: float) -> int:
    """For libusb, to which 0 means for ever."""
    return max(1, round(duration_s * 1000))
