"""Nikon's operations on the simulated body, as libgphoto2 uses them."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from drivers.ptp.codes import DataType, NikonOperation, ResponseCode
from drivers.ptp.cursor import array_bytes
from drivers.ptp.vendor_events import encode_nikon_events
from drivers.sim.ptp_responder.answer import Answer, RefusalError
from drivers.sim.ptp_responder.shutter import Order
from drivers.sim.ptp_responder.standard import Call, Handler

LIVE_HEADER_BYTES = 384  # before the JPEG of a live view image; bodies differ, hosts search

_WITH_AUTOFOCUS = 0xFFFFFFFE
_TO_SDRAM = 1


def _change_mode(call: Call) -> Answer:
    if call.parameters[0] > 1:
        raise RefusalError(ResponseCode.INVALID_PARAMETER)
    call.body.is_remote = bool(call.parameters[0])
    return Answer()


def _property_codes(call: Call) -> Answer:
    return Answer(data=array_bytes(DataType.UINT16, call.body.model.vendor_properties))


def _events(call: Call) -> Answer:
    events = encode_nikon_events(call.body.shutter.listed)
    call.body.shutter.listed.clear()
    return Answer(data=events)


def _is_ready(call: Call) -> Answer:
    return Answer(ResponseCode.DEVICE_BUSY if call.body.is_busy else ResponseCode.OK)


def _capture(call: Call) -> Answer:
    with_autofocus, target = call.parameters[0] == _WITH_AUTOFOCUS, call.parameters[1]
    call.body.shutter.release(
        Order(with_autofocus, target == _TO_SDRAM, fault=call.body.event_fault)
    )
    return Answer()


def _capture_in_sdram(call: Call) -> Answer:
    call.body.shutter.release(Order(to_sdram=True, fault=call.body.event_fault))
    return Answer()


def _focus_and_capture_in_sdram(call: Call) -> Answer:
    call.body.shutter.release(
        Order(with_autofocus=True, to_sdram=True, fault=call.body.event_fault)
    )
    return Answer()


def _empty_sdram(call: Call) -> Answer:
    call.body.store.empty_sdram()
    return Answer()


def _focus(call: Call) -> Answer:
    call.body.shutter.focus()
    return Answer()


def _large_thumb(call: Call) -> Answer:
    stored = call.body.store.get(call.parameters[0])
    return Answer(data=call.body.developer.jpeg(stored.data, stored.media_type))


def _start_live_view(call: Call) -> Answer:
    call.body.start_live_view()
    return Answer()


def _end_live_view(call: Call) -> Answer:
    call.body.end_live_view()
    return Answer()


def _live_image(call: Call) -> Answer:
    jpeg = call.body.live_image()
    header = struct.pack(">I", len(jpeg)).ljust(LIVE_HEADER_BYTES, b"\0")
    return Answer(data=header + jpeg)


def _drive_focus(call: Call) -> Answer:
    if not call.body.is_live:
        raise RefusalError(ResponseCode.NIKON_NOT_LIVE_VIEW)
    if call.parameters[0] not in {1, 2}:
        raise RefusalError(ResponseCode.INVALID_PARAMETER)
    return Answer()


HANDLERS: Mapping[int, Handler] = {
    NikonOperation.CAPTURE: _capture_in_sdram,
    NikonOperation.AF_DRIVE: _focus,
    NikonOperation.CHANGE_CAMERA_MODE: _change_mode,
    NikonOperation.DELETE_IMAGES_IN_SDRAM: _empty_sdram,
    NikonOperation.GET_LARGE_THUMB: _large_thumb,
    NikonOperation.GET_EVENT: _events,
    NikonOperation.DEVICE_READY: _is_ready,
    NikonOperation.GET_VENDOR_PROP_CODES: _property_codes,
    NikonOperation.AF_AND_CAPTURE_IN_SDRAM: _focus_and_capture_in_sdram,
    NikonOperation.START_LIVE_VIEW: _start_live_view,
    NikonOperation.END_LIVE_VIEW: _end_live_view,
    NikonOperation.GET_LIVE_VIEW_IMAGE: _live_image,
    NikonOperation.MANUAL_FOCUS_DRIVE: _drive_focus,
    NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA: _capture,
}
