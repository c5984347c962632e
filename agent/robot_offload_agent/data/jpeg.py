"""Raw images as JPEG on the link: `sensor_msgs/msg/Image` in serialized form to a fraction of its bytes, and back.

The nodes on both sides see plain images. What crosses is `MAGIC`, the length of the message's head, the head as it was
serialized (stamp, frame, size, encoding) and the JPEG. A message that is no image of a known encoding crosses as it is.
The pixels are compressed by Pillow, an extra: decision 0017 says why.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from io import BytesIO
from types import ModuleType

from robot_offload_agent.errors import StartError

MAGIC = b"ROJ1"
"""No serialized message begins so: the first byte of the encapsulation is 0 (OMG DDSI-RTPS 2.5, section 10.2)."""
ENCODINGS = {"rgb8": ("RGB", "RGB", 3), "bgr8": ("RGB", "BGR", 3), "mono8": ("L", "L", 1)}
"""Pillow's mode, its order of the bytes, and bytes of a pixel, by the encoding of the message."""
MOST_BYTES = 16 << 20
"""Of a decoded image: what the agents carry at most."""
PADDING = 3
"""Bytes that a serializer may put behind the message."""
_LENGTH = struct.Struct("!I")


class JpegError(Exception):
    """What arrived is no compressed image of ours."""


@dataclass(frozen=True)
class Layout:
    """Where the parts of a serialized image are.

    Attributes:
        width, height: pixels. encoding: as the message names it.
        start, size: of the pixels in the message, bytes.
    """

    width: int
    height: int
    encoding: str
    start: int
    size: int


def pillow() -> ModuleType:
    """Return Pillow's module of images; raise StartError where it is not installed."""
    try:
        from PIL import Image  # noqa: PLC0415 - an extra: only who declares jpegQuality needs it
    except ImportError as error:
        raise StartError(
            "parameter input.*.jpeg_quality needs Pillow: install python3-pil (apt) or `robot-offload-agent[jpeg]`, in "
            "the cloud an agent image with it (`--build-arg EXTRAS=pillow`)"
        ) from error
    return Image


def layout(message: bytes) -> Layout | None:
    """Return the parts of a serialized image whose pixels stand without gaps; None for anything else."""
    order = "<" if message[1:2] == b"\x01" else ">"
    if message[:1] != b"\0" or len(message) < 16:
        return None
    try:
        position = 12  # behind encapsulation and stamp
        position = _aligned(position + 4 + struct.unpack_from(f"{order}I", message, position)[0])
        height, width, length = struct.unpack_from(f"{order}III", message, position)
        position += 12
        encoding = bytes(message[position : position + length]).rstrip(b"\0").decode("ascii")
        position = _aligned(position + length + 1)  # the flag of the byte order
        step, size = struct.unpack_from(f"{order}II", message, position)
    except (struct.error, UnicodeDecodeError):
        return None
    start = position + 8
    known = ENCODINGS.get(encoding)
    if known is None or step != width * known[2] or size != step * height:
        return None
    return Layout(width, height, encoding, start, size) if 0 <= len(message) - start - size <= PADDING else None


def _aligned(position: int) -> int:
    return (position + 3) // 4 * 4


def pack(message: bytes, quality: int) -> bytes:
    """Return an image as what crosses; any other message, and an image that would not get smaller, as it is."""
    found = layout(message)
    if found is None or not found.size:
        return message
    mode, order, _ = ENCODINGS[found.encoding]
    pixels = memoryview(message)[found.start : found.start + found.size]
    made = BytesIO()
    size = found.width, found.height
    try:
        pillow().frombuffer(mode, size, pixels, "raw", order, 0, 1).save(made, "JPEG", quality=quality)
    except (OSError, ValueError):  # such as more than 65,500 pixels in a row
        return message
    packed = b"".join((MAGIC, _LENGTH.pack(found.start), message[: found.start], made.getbuffer()))
    return packed if len(packed) < len(message) else message


def unpack(crossed: bytes) -> bytes:
    """Return the message that was packed; one that was not, as it is.

    Raises:
        JpegError: it is damaged, or decodes to another size than its head says.
        StartError: Pillow is not installed.
    """
    if crossed[: len(MAGIC)] != MAGIC:
        return crossed
    head, jpeg = _parts(crossed)
    found = layout_of_head(head)
    image = pillow()
    try:
        with image.open(BytesIO(jpeg), formats=("JPEG",)) as opened:
            if opened.size != (found.width, found.height):
                raise JpegError(f"{opened.size} pixels instead of {found.width} x {found.height}")
            mode, order, _ = ENCODINGS[found.encoding]
            pixels = opened.convert(mode).tobytes("raw", order)
    except (OSError, ValueError, SyntaxError, image.DecompressionBombError) as error:
        raise JpegError(f"{len(jpeg)} bytes are no JPEG: {error}") from error
    return head + bytes(pixels)


def _parts(crossed: bytes) -> tuple[bytes, bytes]:
    start = len(MAGIC) + _LENGTH.size
    if len(crossed) < start:
        raise JpegError(f"{len(crossed)} bytes")
    end = start + int(_LENGTH.unpack_from(crossed, len(MAGIC))[0])
    if end > len(crossed):
        raise JpegError("the head is longer than the message")
    return crossed[start:end], crossed[end:]


def layout_of_head(head: bytes) -> Layout:
    """Return the parts of the image that a head announces; raise JpegError."""
    order = "<" if head[1:2] == b"\x01" else ">"
    size = struct.unpack_from(f"{order}I", head, len(head) - 4)[0] if len(head) >= 16 else 0
    found = layout(head + bytes(size)) if 0 < size <= MOST_BYTES else None
    if found is None or found.start != len(head):
        raise JpegError("the head is none of an image")
    return found
