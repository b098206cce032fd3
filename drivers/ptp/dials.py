"""Properties that describe themselves (GetDevicePropDesc): read, set, read back."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from drivers.errors import SettingsError
from drivers.ptp.codes import Operation, ResponseCode
from drivers.ptp.cursor import Cursor, value_bytes
from drivers.ptp.errors import PtpRefusedError
from drivers.ptp.exposure import Scale
from drivers.ptp.properties import Choices, PropertyDescription, Range
from drivers.ptp.session import PtpSession

READ_BACK_TRIES = 5
READ_BACK_PAUSE_S = 0.1
_ABSENT = frozenset({ResponseCode.PROPERTY_NOT_SUPPORTED, ResponseCode.OPERATION_NOT_SUPPORTED})


class Dials:
    """The properties of a camera.

    Parameters
    ----------
    session
        With the camera.
    supported
        Codes of the properties that it says it has.
    """

    def __init__(self, session: PtpSession, supported: Collection[int]) -> None:
        self._session = session
        self._supported = frozenset(supported)

    def __contains__(self, code: int) -> bool:
        return code in self._supported

    def describe(self, code: int) -> PropertyDescription | None:
        """What a property is and may be; None when the camera has no such property."""
        if code not in self._supported:
            return None
        try:
            reply = self._session.ask(Operation.GET_DEVICE_PROP_DESC, code)
        except PtpRefusedError as error:
            if error.code in _ABSENT:
                return None
            raise
        return PropertyDescription.decode(reply.data)

    def number(self, code: int) -> int | None:
        """The value of a property that is a number; None when the camera has no such one."""
        about = self.describe(code)
        return about.current if about is not None and isinstance(about.current, int) else None

    def quantity(self, code: int, scale: Scale) -> float | None:
        """The value of a property in the units of its scale."""
        number = self.number(code)
        return None if number is None else scale.value(number)

    def turn(self, code: int, scale: Scale, asked: float, locked: str) -> None:
        """Set a property to a quantity and read it back.

        Parameters
        ----------
        code, scale, asked
            The property and the value that it shall have.
        locked
            What to do if the camera does not let it be changed.
        """
        about = self.describe(code)
        if about is None or not isinstance(about.current, int):
            raise SettingsError(
                f"this camera's {scale.name} cannot be set from here; set it by hand and leave "
                "it out of the plan"
            )
        if scale.is_same(asked, about.current):
            return
        if not about.is_writable:
            now = scale.value(about.current)
            shown = "none" if now is None else scale.text(now)
            raise SettingsError(
                f"the camera does not let its {scale.name} be changed from {shown} to "
                f"{scale.text(asked)}; {locked}"
            )
        self.set_number(about, scale.choose(asked, _offered(about, scale, asked)), scale.name)

    def set_number(self, about: PropertyDescription, number: int, name: str) -> None:
        """Set a property to a number and read it back; cameras take a moment."""
        session = self._session
        if about.current == number:
            return
        data = value_bytes(about.kind, number)
        try:
            session.ask(Operation.SET_DEVICE_PROP_VALUE, about.code, data=data)
        except PtpRefusedError as error:
            raise SettingsError(
                f"the camera does not take {number} for its {name}: {error}; "
                "check the mode dial (M) and try again"
            ) from error
        for _ in range(READ_BACK_TRIES):
            answer = session.ask(Operation.GET_DEVICE_PROP_VALUE, about.code).data
            found = Cursor(answer, name).value(about.kind)
            if found == number:
                return
            session.clock.sleep(READ_BACK_PAUSE_S)
        raise SettingsError(
            f"the camera was told {number} for its {name} and reads back {found}; "
            "check the mode dial (M) and the lens, then try again"
        )


def _offered(about: PropertyDescription, scale: Scale, asked: float) -> Iterable[int]:
    """The numbers that may be set, or those around `asked` where they are too many."""
    match about.allowed:
        case Choices(values):
            return [value for value in values if isinstance(value, int)]
        case Range(minimum, maximum, step):
            steps = (scale.number(asked) - minimum) // max(step, 1)
            around = (minimum + k * max(step, 1) for k in (steps, steps + 1))
            return [min(max(number, minimum), maximum) for number in around]
        case _:
            return [scale.number(asked)]
