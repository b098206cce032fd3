"""The numbers of PTP that are used here: ISO 15740, Nikon's and Canon's extensions.

Numbers after ISO 15740:2013 and the PIMA 15740:2000 tables, the vendors' after the public
headers of libgphoto2 (camlibs/ptp2/ptp.h). Nikon's and Canon's numbers overlap, hence one
enumeration each.
"""

from __future__ import annotations

from enum import IntEnum

UNDEFINED_LENGTH = 0xFFFFFFFF  # length of a USB container whose end only a short packet tells
UNDEFINED_TOTAL = 0xFFFFFFFFFFFFFFFF  # the same in PTP/IP's Start_Data


class ContainerType(IntEnum):
    """Types of USB containers."""

    COMMAND = 1
    DATA = 2
    RESPONSE = 3
    EVENT = 4


class PacketType(IntEnum):
    """Types of PTP/IP packets (CIPA DC-X005)."""

    INIT_COMMAND_REQUEST = 1
    INIT_COMMAND_ACK = 2
    INIT_EVENT_REQUEST = 3
    INIT_EVENT_ACK = 4
    INIT_FAIL = 5
    COMMAND_REQUEST = 6
    COMMAND_RESPONSE = 7
    EVENT = 8
    START_DATA = 9
    DATA = 10
    CANCEL = 11
    END_DATA = 12
    PROBE_REQUEST = 13
    PROBE_RESPONSE = 14


class DataPhase(IntEnum):
    """PTP/IP's announcement of where a command's data go."""

    NONE_OR_IN = 1
    OUT = 2


class ClassRequest(IntEnum):
    """USB class requests of a still image device (USB Still Image Capture Device 1.0)."""

    CANCEL = 0x64
    DEVICE_RESET = 0x66
    GET_DEVICE_STATUS = 0x67


class DataType(IntEnum):
    """Types of property values; an array's is the element's with `ARRAY` set."""

    UNDEFINED = 0x0000
    INT8 = 0x0001
    UINT8 = 0x0002
    INT16 = 0x0003
    UINT16 = 0x0004
    INT32 = 0x0005
    UINT32 = 0x0006
    INT64 = 0x0007
    UINT64 = 0x0008
    INT128 = 0x0009
    UINT128 = 0x000A
    STRING = 0xFFFF


ARRAY = 0x4000


class Operation(IntEnum):
    """Standard operations."""

    GET_DEVICE_INFO = 0x1001
    OPEN_SESSION = 0x1002
    CLOSE_SESSION = 0x1003
    GET_STORAGE_IDS = 0x1004
    GET_STORAGE_INFO = 0x1005
    GET_NUM_OBJECTS = 0x1006
    GET_OBJECT_HANDLES = 0x1007
    GET_OBJECT_INFO = 0x1008
    GET_OBJECT = 0x1009
    GET_THUMB = 0x100A
    DELETE_OBJECT = 0x100B
    SEND_OBJECT_INFO = 0x100C
    SEND_OBJECT = 0x100D
    INITIATE_CAPTURE = 0x100E
    FORMAT_STORE = 0x100F
    RESET_DEVICE = 0x1010
    SELF_TEST = 0x1011
    SET_OBJECT_PROTECTION = 0x1012
    POWER_DOWN = 0x1013
    GET_DEVICE_PROP_DESC = 0x1014
    GET_DEVICE_PROP_VALUE = 0x1015
    SET_DEVICE_PROP_VALUE = 0x1016
    RESET_DEVICE_PROP_VALUE = 0x1017
    TERMINATE_OPEN_CAPTURE = 0x1018
    GET_PARTIAL_OBJECT = 0x101B
    INITIATE_OPEN_CAPTURE = 0x101C


class NikonOperation(IntEnum):
    """Nikon's operations."""

    CAPTURE = 0x90C0
    AF_DRIVE = 0x90C1
    CHANGE_CAMERA_MODE = 0x90C2
    DELETE_IMAGES_IN_SDRAM = 0x90C3
    GET_LARGE_THUMB = 0x90C4
    GET_EVENT = 0x90C7
    DEVICE_READY = 0x90C8
    GET_VENDOR_PROP_CODES = 0x90CA
    AF_AND_CAPTURE_IN_SDRAM = 0x90CB
    GET_PICTURE_CONTROL_DATA = 0x90CC
    START_LIVE_VIEW = 0x9201
    END_LIVE_VIEW = 0x9202
    GET_LIVE_VIEW_IMAGE = 0x9203
    MANUAL_FOCUS_DRIVE = 0x9204
    CHANGE_AF_AREA = 0x9205
    AF_DRIVE_CANCEL = 0x9206
    INITIATE_CAPTURE_REC_IN_MEDIA = 0x9207


class CanonOperation(IntEnum):
    """Operations of Canon EOS."""

    GET_OBJECT_INFO_EX = 0x9109
    GET_OBJECT = 0x9104
    GET_PARTIAL_OBJECT = 0x9107
    SET_DEVICE_PROP_VALUE_EX = 0x9110
    SET_REMOTE_MODE = 0x9114
    SET_EVENT_MODE = 0x9115
    GET_EVENT = 0x9116
    TRANSFER_COMPLETE = 0x9117
    PC_HDD_CAPACITY = 0x911A
    KEEP_DEVICE_ON = 0x911D
    REQUEST_DEVICE_PROP_VALUE = 0x9127
    REMOTE_RELEASE_ON = 0x9128
    REMOTE_RELEASE_OFF = 0x9129
    INITIATE_VIEWFINDER = 0x9151
    TERMINATE_VIEWFINDER = 0x9152
    GET_VIEWFINDER_DATA = 0x9153


class ResponseCode(IntEnum):
    """Standard responses, then Nikon's (A0xx and A2xx) and Canon's (A1xx)."""

    UNDEFINED = 0x2000
    OK = 0x2001
    GENERAL_ERROR = 0x2002
    SESSION_NOT_OPEN = 0x2003
    INVALID_TRANSACTION_ID = 0x2004
    OPERATION_NOT_SUPPORTED = 0x2005
    PARAMETER_NOT_SUPPORTED = 0x2006
    INCOMPLETE_TRANSFER = 0x2007
    INVALID_STORAGE_ID = 0x2008
    INVALID_OBJECT_HANDLE = 0x2009
    PROPERTY_NOT_SUPPORTED = 0x200A
    INVALID_OBJECT_FORMAT_CODE = 0x200B
    STORE_FULL = 0x200C
    OBJECT_WRITE_PROTECTED = 0x200D
    STORE_READ_ONLY = 0x200E
    ACCESS_DENIED = 0x200F
    NO_THUMBNAIL_PRESENT = 0x2010
    SELF_TEST_FAILED = 0x2011
    PARTIAL_DELETION = 0x2012
    STORE_NOT_AVAILABLE = 0x2013
    SPECIFICATION_BY_FORMAT_UNSUPPORTED = 0x2014
    NO_VALID_OBJECT_INFO = 0x2015
    INVALID_CODE_FORMAT = 0x2016
    UNKNOWN_VENDOR_CODE = 0x2017
    CAPTURE_ALREADY_TERMINATED = 0x2018
    DEVICE_BUSY = 0x2019
    INVALID_PARENT_OBJECT = 0x201A
    INVALID_PROPERTY_FORMAT = 0x201B
    INVALID_PROPERTY_VALUE = 0x201C
    INVALID_PARAMETER = 0x201D
    SESSION_ALREADY_OPEN = 0x201E
    TRANSACTION_CANCELLED = 0x201F
    SPECIFICATION_OF_DESTINATION_UNSUPPORTED = 0x2020
    NIKON_HARDWARE_ERROR = 0xA001
    NIKON_OUT_OF_FOCUS = 0xA002
    NIKON_CHANGE_CAMERA_MODE_FAILED = 0xA003
    NIKON_INVALID_STATUS = 0xA004
    NIKON_SET_PROPERTY_NOT_SUPPORTED = 0xA005
    NIKON_WHITE_BALANCE_RESET_ERROR = 0xA006
    NIKON_DUST_REFERENCE_ERROR = 0xA007
    NIKON_SHUTTER_SPEED_BULB = 0xA008
    NIKON_MIRROR_UP_SEQUENCE = 0xA009
    NIKON_CAMERA_MODE_NOT_ADJUST_F_NUMBER = 0xA00A
    NIKON_NOT_LIVE_VIEW = 0xA00B
    CANON_BATTERY_LOW = 0xA101
    CANON_NOT_READY = 0xA102
    CANON_MEMORY_NOT_READY = 0xA106
    NIKON_BULB_RELEASE_BUSY = 0xA200
    NIKON_WAITING_SECOND_RELEASE = 0xA207


class EventCode(IntEnum):
    """Standard events."""

    CANCEL_TRANSACTION = 0x4001
    OBJECT_ADDED = 0x4002
    OBJECT_REMOVED = 0x4003
    STORE_ADDED = 0x4004
    STORE_REMOVED = 0x4005
    DEVICE_PROP_CHANGED = 0x4006
    OBJECT_INFO_CHANGED = 0x4007
    DEVICE_INFO_CHANGED = 0x4008
    REQUEST_OBJECT_TRANSFER = 0x4009
    STORE_FULL = 0x400A
    DEVICE_RESET = 0x400B
    STORAGE_INFO_CHANGED = 0x400C
    CAPTURE_COMPLETE = 0x400D
    UNREPORTED_STATUS = 0x400E


class NikonEvent(IntEnum):
    """Nikon's events."""

    OBJECT_ADDED_IN_SDRAM = 0xC101
    CAPTURE_COMPLETE_REC_IN_SDRAM = 0xC102
    ADVANCED_TRANSFER = 0xC103
    PREVIEW_IMAGE_ADDED = 0xC104
    MIRROR_UP = 0xC106
    MIRROR_UP_CANCELLED = 0xC107


class CanonRecord(IntEnum):
    """Types of the records that Canon's GetEvent delivers."""

    END = 0x0000
    OBJECT_ADDED = 0xC181
    OBJECT_REMOVED = 0xC182
    REQUEST_OBJECT_TRANSFER = 0xC186
    PROPERTY_VALUE = 0xC189
    PROPERTY_CHOICES = 0xC18A
    OBJECT_ADDED_64 = 0xC1A7
    REQUEST_OBJECT_TRANSFER_64 = 0xC1A9


class Property(IntEnum):
    """Standard properties."""

    BATTERY_LEVEL = 0x5001
    FUNCTIONAL_MODE = 0x5002
    IMAGE_SIZE = 0x5003
    COMPRESSION = 0x5004
    WHITE_BALANCE = 0x5005
    F_NUMBER = 0x5007
    FOCAL_LENGTH = 0x5008
    FOCUS_MODE = 0x500A
    EXPOSURE_METERING_MODE = 0x500B
    FLASH_MODE = 0x500C
    EXPOSURE_TIME = 0x500D
    EXPOSURE_PROGRAM = 0x500E
    EXPOSURE_INDEX = 0x500F
    EXPOSURE_BIAS = 0x5010
    DATE_TIME = 0x5011
    STILL_CAPTURE_MODE = 0x5013
    BURST_NUMBER = 0x5018
    FOCUS_METERING_MODE = 0x501C
    ARTIST = 0x501E
    COPYRIGHT = 0x501F


class NikonProperty(IntEnum):
    """Nikon's properties."""

    AUTO_ISO = 0xD054
    EXPOSURE_DELAY = 0xD06A
    SHUTTER_SPEED = 0xD100
    EXTERNAL_FLASH_ATTACHED = 0xD101
    RECORDING_MEDIA = 0xD10B
    AF_MODE = 0xD161
    LIVE_VIEW_STATUS = 0xD1A2
    LIVE_VIEW_PROHIBITION = 0xD1A4


class CanonProperty(IntEnum):
    """Properties of Canon EOS."""

    APERTURE = 0xD101
    SHUTTER_SPEED = 0xD102
    ISO_SPEED = 0xD103
    AUTO_EXPOSURE_MODE = 0xD105
    FOCUS_MODE = 0xD108
    BATTERY_POWER = 0xD111
    CAPTURE_DESTINATION = 0xD11C
    IMAGE_FORMAT = 0xD120
    VIEWFINDER_OUTPUT = 0xD1B0


class Format(IntEnum):
    """Object formats."""

    UNDEFINED = 0x3000  # what Nikon calls its NEF
    ASSOCIATION = 0x3001
    EXIF_JPEG = 0x3801
    TIFF_EP = 0x3802
    TIFF = 0x380D
    DNG = 0x3811
    CANON_CRW = 0xB101
    CANON_CR2 = 0xB103
    CANON_CR3 = 0xB108


class Form(IntEnum):
    """What a property's description says of the values it takes."""

    NONE = 0
    RANGE = 1
    ENUMERATION = 2


def operation_name(code: int) -> str:
    """An operation's name and number for a message."""
    return _name(code, Operation, NikonOperation, CanonOperation)


def response_name(code: int) -> str:
    """A response's name and number for a message."""
    return _name(code, ResponseCode)


def _name(code: int, *families: type[IntEnum]) -> str:
    for member in (member for family in families for member in family):
        if member == code:
            return f"{member.name.lower().replace('_', ' ')} (0x{code:04X})"
    return f"0x{code:04X}"
