r"""A shutter box on a serial line, for cameras that a computer cannot control.

The box closes a camera's remote-release contact. `firmware/trigger` holds the sketch that makes an
Arduino one, and its README the wiring.

The line protocol, 115200 baud, 8N1, ASCII. The computer asks, the box answers, one line each::

    >SS COMMAND*CCCC\n          a request
    <SS OK TEXT*CCCC\n          its answer; TEXT and the space before it may be missing
    <SS ERR REASON*CCCC\n       it was understood but not done

SS is the request's number, two capital hexadecimal digits; the answer repeats it. CCCC is the
CRC-16 of what stands between the first character of the line and ``*`` (polynomial 0x1021, start
0xFFFF, not reflected; "123456789" gives 29B1), four capital hexadecimal digits. A line that is
not exactly so is noise to both sides and gets no answer; then the computer repeats its request.
A request with the number of the one before it is not carried out again: the box repeats its
answer. So each exposure is made once, whatever the line loses.

===========  ==============================================================================
``HELLO``    answers ``OK lumisplit-trigger 1`` and forgets the number before; always first
``FIRE MS``  closes the contact for MS (1 to 3600000) milliseconds, then answers ``OK``
===========  ==============================================================================

Reasons: ``hello`` (the box has restarted and was not greeted), ``command``, ``time``.
"""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass

from drivers.errors import SerialError
from drivers.serial_line import SerialLine

BAUD = 115200
VERSION = "lumisplit-trigger 1"
MAX_PULSE_S = 3600.0


@dataclass(frozen=True, slots=True)
class _Reply:
    done: bool
    text: str


class TriggerBox:
    """A shutter box, greeted and ready.

    Parameters
    ----------
    port
        Serial port that it hangs on.
    pulse_s
        How long the contact stays closed, 0.001 to 3600 s: enough for the camera to notice, or
        the exposure itself where the camera is set to bulb.
    answer_s
        How long to wait for an answer, beyond the pulse, before asking again.
    greeting_s
        The same for the first answer: an Arduino restarts when its port is opened, and is deaf
        for up to two seconds.

    Raises
    ------
    SerialError
        There is no such port, or no such box on it.
    """

    def __init__(
        self, port: str, pulse_s: float, answer_s: float = 1.0, greeting_s: float = 2.5
    ) -> None:
        if not 0.001 <= pulse_s <= MAX_PULSE_S:
            raise ValueError(f"a pulse lasts 0.001 to {MAX_PULSE_S:.0f} s, not {pulse_s}")
        self._pulse_s, self._answer_s = pulse_s, answer_s
        self._line = SerialLine(port, BAUD)
        self._number = 0
        try:
            version = self._ask("HELLO", greeting_s)
            if version != VERSION:
                raise SerialError(
                    f"The box on {port} calls itself {version!r}, not {VERSION!r}. Load the sketch "
                    "in firmware/trigger onto it."
                )
        except SerialError:
            self.close()
            raise

    def fire(self) -> None:
        """Release the shutter once; returns when the contact has opened again.

        Raises
        ------
        SerialError
            The box does not answer; whether the shutter was released is not known then.
        """
        self._number = (self._number + 1) % 256
        self._ask(f"FIRE {round(1000 * self._pulse_s)}", self._pulse_s + self._answer_s)

    def close(self) -> None:
        """Close the port; may be called more than once."""
        self._line.close()

    def _ask(self, command: str, limit_s: float) -> str:
        number = f"{self._number:02X}"
        body = f"{number} {command}".encode()
        request = b">%b*%04X\n" % (body, crc_hqx(body, 0xFFFF))
        reply = self._line.ask(request, b"\n", lambda line: _read(line, number), limit_s)
        if not reply.done:
            why = {
                "hello": "it has restarted; its power may be failing. Run the same command again",
                "command": "it does not know this command. Load the sketch in firmware/trigger",
                "time": "it cannot keep the contact closed for so long",
            }.get(reply.text, reply.text)
            raise SerialError(f"The shutter box on {self._line.port} refused {command!r}: {why}.")
        return reply.text


def _read(line: bytes, number: str) -> _Reply | None:
    """The answer to a request, if the line is it and whole; noise before it is skipped."""
    body, star, check = line.rpartition(b"<")[2].rpartition(b"*")
    if not star or check != b"%04X" % crc_hqx(body, 0xFFFF):
        return None
    answered, _, rest = body.decode("ascii", "replace").partition(" ")
    verdict, _, text = rest.partition(" ")
    if answered != number or verdict not in {"OK", "ERR"}:
        return None
    return _Reply(verdict == "OK", text)
