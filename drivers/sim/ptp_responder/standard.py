"""The standard's operations on the simulated body (ISO 15740:2013, chapter 10)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from drivers.ptp.codes import DataType, EventCode, Operation, ResponseCode
from drivers.ptp.cursor import Cursor, array_bytes, value_bytes
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.transaction import Event
from drivers.ptp.wire import Bytes
from drivers.sim.ptp_responder.answer import Answer, RefusalError
from drivers.sim.ptp_responder.camera import SimulatedBody
from drivers.sim.ptp_responder.shutter import Order
from drivers.sim.ptp_responder.store import EVERY, STORAGE


@dataclass(frozen=True, slots=True)
class Call:
    """An operation on a body: its parameters, always five, and what data came with it."""

    body: SimulatedBody
    parameters: tuple[int, ...]
    data: Bytes


Handler: TypeAlias = Callable[[Call], Answer]

TAKES_DATA = frozenset(
    {Operation.SET_DEVICE_PROP_VALUE, Operation.SEND_OBJECT_INFO, Operation.SEND_OBJECT}
)
WITHOUT_SESSION = frozenset({Operation.GET_DEVICE_INFO, Operation.OPEN_SESSION})


def _device_info(call: Call) -> Answer:
    return Answer(data=call.body.model.info.encode())


def _open_session(call: Call) -> Answer:
    if call.body.session:
        return Answer(ResponseCode.SESSION_ALREADY_OPEN, (call.body.session,))
    if not call.parameters[0]:
        raise RefusalError(ResponseCode.INVALID_PARAMETER)
    call.body.session = call.parameters[0]
    return Answer()


def _close_session(call: Call) -> Answer:
    call.body.leave()
    return Answer()


def _storage_ids(call: Call) -> Answer:
    stores = (STORAGE,) if call.body.store.has_card else ()
    return Answer(data=array_bytes(DataType.UINT32, stores))


def _storage_info(call: Call) -> Answer:
    _check_storage(call.body, call.parameters[0])
    return Answer(data=call.body.store.storage_info().encode())


def _count(call: Call) -> Answer:
    return Answer(parameters=(len(_handles(call)),))


def _object_handles(call: Call) -> Answer:
    return Answer(data=array_bytes(DataType.UINT32, _handles(call)))


def _object_info(call: Call) -> Answer:
    return Answer(data=call.body.store.get(call.parameters[0]).info.encode())


def _object(call: Call) -> Answer:
    return Answer(data=call.body.store.get(call.parameters[0]).data)


def _partial_object(call: Call) -> Answer:
    handle, offset, count, _, _ = call.parameters
    whole = memoryview(call.body.store.get(handle).data)
    if offset > len(whole):
        raise RefusalError(ResponseCode.INVALID_PARAMETER)
    part = whole[offset : offset + count]
    return Answer(parameters=(len(part),), data=part)


def _thumb(call: Call) -> Answer:
    stored = call.body.store.get(call.parameters[0])
    if not stored.data:
        raise RefusalError(ResponseCode.NO_THUMBNAIL_PRESENT)
    return Answer(data=call.body.developer.thumbnail(stored.data, stored.media_type))


def _delete(call: Call) -> Answer:
    call.body.store.delete(call.parameters[0])
    return Answer()


def _format(call: Call) -> Answer:
    _check_storage(call.body, call.parameters[0])
    call.body.store.delete(EVERY)
    return Answer()


def _read_only(_: Call) -> Answer:
    return Answer(ResponseCode.STORE_READ_ONLY)


def _capture(call: Call) -> Answer:
    call.body.shutter.release(
        Order(with_autofocus=True, is_pushed=True, fault=call.body.event_fault)
    )
    return Answer()


def _describe(call: Call) -> Answer:
    return Answer(data=call.body.properties.describe(call.parameters[0]).encode())


def _value(call: Call) -> Answer:
    description = call.body.properties.describe(call.parameters[0])
    return Answer(data=value_bytes(description.kind, description.current))


def _set_value(call: Call) -> Answer:
    code = call.parameters[0]
    cursor = Cursor(call.data, "property value")
    try:
        value = cursor.value(call.body.properties.describe(code).kind)
    except PtpProtocolError:
        raise RefusalError(ResponseCode.INVALID_PROPERTY_FORMAT) from None
    if cursor.left:
        raise RefusalError(ResponseCode.INVALID_PROPERTY_FORMAT)
    call.body.properties.set(code, value)
    call.body.shutter.tell([Event(EventCode.DEVICE_PROP_CHANGED, (code,))], is_pushed=False)
    return Answer()


def _check_storage(body: SimulatedBody, storage: int) -> None:
    if storage != STORAGE or not body.store.has_card:
        raise RefusalError(ResponseCode.INVALID_STORAGE_ID)


def _handles(call: Call) -> tuple[int, ...]:
    storage, object_format, parent, _, _ = call.parameters
    if storage != EVERY:
        _check_storage(call.body, storage)
    return call.body.store.handles(object_format, parent)


HANDLERS: Mapping[int, Handler] = {
    Operation.GET_DEVICE_INFO: _device_info,
    Operation.OPEN_SESSION: _open_session,
    Operation.CLOSE_SESSION: _close_session,
    Operation.GET_STORAGE_IDS: _storage_ids,
    Operation.GET_STORAGE_INFO: _storage_info,
    Operation.GET_NUM_OBJECTS: _count,
    Operation.GET_OBJECT_HANDLES: _object_handles,
    Operation.GET_OBJECT_INFO: _object_info,
    Operation.GET_OBJECT: _object,
    Operation.GET_THUMB: _thumb,
    Operation.DELETE_OBJECT: _delete,
    Operation.SEND_OBJECT_INFO: _read_only,
    Operation.SEND_OBJECT: _read_only,
    Operation.INITIATE_CAPTURE: _capture,
    Operation.FORMAT_STORE: _format,
    Operation.GET_DEVICE_PROP_DESC: _describe,
    Operation.GET_DEVICE_PROP_VALUE: _value,
    Operation.SET_DEVICE_PROP_VALUE: _set_value,
    Operation.GET_PARTIAL_OBJECT: _partial_object,
}
