"""The door to rcl's C functions: requests and responses as serialized bytes.

rclpy has no raw services. It turns each request into Python objects while it holds the interpreter: 14 ms for a path of
1,000 poses. In C the same message is read and written in less than 1 ms, and other threads go on meanwhile. rclpy
cannot make the id of a request either, which a successor needs to answer its predecessor's calls.
"""

from __future__ import annotations

import ctypes
from ctypes import CFUNCTYPE, POINTER, Structure, byref, c_char, c_char_p, c_int, c_int64, c_size_t, c_uint8, c_void_p
from functools import cache
from typing import Any

from rclpy.type_support import check_for_type_support

from robot_offload_agent.errors import StartError

REQUEST_ID_BYTES = 24
"""Bytes of `rmw_request_id_t`: the client's identity 16, its sequence number 8."""
_SERVICE_TAKE_FAILED = 601
_CLIENT_TAKE_FAILED = 501


class NativeError(Exception):
    """A C function of rcl or rmw failed; the text is that function's."""


class _RequestId(Structure):
    _fields_ = (("client", c_uint8 * 16), ("sequence", c_int64))


class _Allocator(Structure):
    _fields_ = tuple((name, c_void_p) for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state"))


class _Bytes(Structure):
    _fields_ = (("buffer", c_void_p), ("length", c_size_t), ("capacity", c_size_t), ("allocator", _Allocator))


class _ErrorText(Structure):
    _fields_ = (("text", c_char * 1024),)


@cache
def library() -> Any:
    """Return librcl, which also gives access to the functions of rmw and rcutils.

    Raises:
        StartError: it cannot be opened, or lacks a function.
    """
    try:
        found = ctypes.CDLL("librcl.so")
        take = [c_void_p, POINTER(_RequestId), c_void_p]
        for name, arguments in {
            "rcl_take_request": take,
            "rcl_take_response": take,
            "rcl_send_response": take,
            "rcl_send_request": [c_void_p, c_void_p, POINTER(c_int64)],
            "rmw_serialize": [c_void_p, c_void_p, POINTER(_Bytes)],
            "rmw_deserialize": [POINTER(_Bytes), c_void_p, c_void_p],
            "rcutils_uint8_array_init": [POINTER(_Bytes), c_size_t, POINTER(_Allocator)],
            "rcutils_uint8_array_fini": [POINTER(_Bytes)],
        }.items():
            function = getattr(found, name)
            function.argtypes, function.restype = arguments, c_int
        found.rcutils_get_default_allocator.restype = _Allocator
        found.rcutils_get_error_string.restype = _ErrorText
        found.rcutils_reset_error.restype = None
    except (OSError, AttributeError) as error:
        raise StartError(f"Services and actions need librcl as ROS 2 Humble to Kilted have it: {error}") from error
    return found


def _check(code: int, what: str) -> None:
    if code:
        text = library().rcutils_get_error_string().text.decode("utf-8", "replace").partition(", at ")[0]
        library().rcutils_reset_error()
        raise NativeError(f"{what}: {text or f'code {code}'}")


class Form:
    """The C form of one message class: makes, serializes and reads its messages."""

    def __init__(self, message: Any) -> None:
        check_for_type_support(message)
        kind = message.__class__
        self.name = message.__name__
        self.support = _pointer(kind._TYPE_SUPPORT)
        self.create = CFUNCTYPE(c_void_p)(_pointer(kind._CREATE_ROS_MESSAGE))
        self.destroy = CFUNCTYPE(None, c_void_p)(_pointer(kind._DESTROY_ROS_MESSAGE))
        self.allocator = library().rcutils_get_default_allocator()

    def write(self, message: int) -> bytes:
        """Return a message as serialized bytes; raise NativeError."""
        rcl, written = library(), _Bytes()
        _check(rcl.rcutils_uint8_array_init(byref(written), 0, byref(self.allocator)), "no memory")
        try:
            _check(rcl.rmw_serialize(message, self.support, byref(written)), f"{self.name} cannot be written")
            return ctypes.string_at(written.buffer, written.length)
        finally:
            rcl.rcutils_uint8_array_fini(byref(written))

    def read(self, data: bytes, message: int) -> None:
        """Fill a message from serialized bytes; raise NativeError."""
        given = _Bytes(ctypes.cast(ctypes.c_char_p(data), c_void_p), len(data), len(data), self.allocator)
        code = library().rmw_deserialize(byref(given), self.support, message)
        _check(code, f"{len(data)} bytes are no {self.name}")

    def empty(self) -> bytes:
        """Return the message with its defaults as serialized bytes."""
        message = self.create()
        try:
            return self.write(message)
        finally:
            self.destroy(message)


def _pointer(capsule: object) -> int:
    api = ctypes.pythonapi
    api.PyCapsule_GetPointer.restype, api.PyCapsule_GetPointer.argtypes = c_void_p, [ctypes.py_object, c_char_p]
    return int(api.PyCapsule_GetPointer(capsule, None))


def take_request(service: int, form: Form) -> tuple[bytes, bytes] | None:
    """Take the next request of a service, whose `rcl_service_t` is at an address.

    Returns:
        The request's id (REQUEST_ID_BYTES) and its serialized bytes; None when there is none.

    Raises:
        NativeError: it cannot be taken.
    """
    return _take(library().rcl_take_request, _SERVICE_TAKE_FAILED, service, form)


def take_response(client: int, form: Form) -> tuple[int, bytes] | None:
    """Take the next response of a client, whose `rcl_client_t` is at an address.

    Returns:
        The sequence number that `send_request` gave, and the response's serialized bytes; None when there is none.

    Raises:
        NativeError: it cannot be taken.
    """
    taken = _take(library().rcl_take_response, _CLIENT_TAKE_FAILED, client, form)
    return None if taken is None else (_RequestId.from_buffer_copy(taken[0]).sequence, taken[1])


def _take(function: Any, nothing: int, entity: int, form: Form) -> tuple[bytes, bytes] | None:
    message, of = form.create(), _RequestId()
    try:
        code = function(entity, byref(of), message)
        if code == nothing:
            library().rcutils_reset_error()
            return None
        _check(code, f"{form.name} cannot be taken")
        return bytes(of), form.write(message)
    finally:
        form.destroy(message)


def send_request(client: int, form: Form, data: bytes) -> int:
    """Send a request given as serialized bytes; return its sequence number; raise NativeError."""
    message, sequence = form.create(), c_int64()
    try:
        form.read(data, message)
        _check(library().rcl_send_request(client, message, byref(sequence)), f"{form.name} cannot be sent")
    finally:
        form.destroy(message)
    return sequence.value


def send_response(service: int, form: Form, request: bytes, data: bytes) -> None:
    """Answer the request of that id with serialized bytes; raise NativeError.

    A client that has gone is not an error: the middleware drops the answer.
    """
    message = form.create()
    try:
        form.read(data, message)
        of = _RequestId.from_buffer_copy(request)
        _check(library().rcl_send_response(service, byref(of), message), f"{form.name} cannot be sent")
    finally:
        form.destroy(message)
