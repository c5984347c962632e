"""Raw images become JPEG for the link and images of the same size again; nothing else is touched."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, LaserScan

from robot_offload_agent.data import jpeg

WIDTH, HEIGHT, QUALITY = 64, 48, 80
BYTES = {"rgb8": 3, "bgr8": 3, "mono8": 1}


def image(encoding: str, frame: str = "camera", *, step: int | None = None) -> Image:
    """Returns a smooth picture: JPEG keeps it nearly as it is."""
    pixel = BYTES.get(encoding, 2)
    message = Image(height=HEIGHT, width=WIDTH, encoding=encoding, step=step or WIDTH * pixel)
    message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec = frame, 7, 9
    rows = (
        bytes((row * 2 + column + 60 * part) % 200 for column in range(WIDTH) for part in range(pixel))
        for row in range(HEIGHT)
    )
    message.data = b"".join(row.ljust(message.step, b"\0") for row in rows)
    return message


@pytest.mark.parametrize("encoding", BYTES)
@pytest.mark.parametrize("frame", ["", "a", "camera_link"])
def test_the_nodes_get_an_image_of_the_same_head_and_nearly_the_same_pixels(encoding: str, frame: str) -> None:
    before = image(encoding, frame)
    packed = jpeg.pack(serialize_message(before), QUALITY)
    assert len(packed) < len(before.data) / 2
    after = deserialize_message(jpeg.unpack(packed), Image)
    for field in ("header", "height", "width", "encoding", "is_bigendian", "step"):
        assert getattr(after, field) == getattr(before, field)
    assert len(after.data) == len(before.data)
    wrong = sum(abs(a - b) for a, b in zip(after.data, before.data, strict=True)) / len(before.data)
    assert wrong < 20, "colours change places only when something is wrong"


@pytest.mark.parametrize(
    "message",
    [image("16UC1"), image("bayer_rggb8"), image("rgb8", step=WIDTH * 3 + 5), Image(), LaserScan(ranges=[1.0] * 500)],
    ids=["depth", "bayer", "padded rows", "empty", "no image"],
)
def test_what_jpeg_cannot_hold_crosses_as_it_is(message: Image | LaserScan) -> None:
    raw = serialize_message(message)
    assert jpeg.pack(raw, QUALITY) is raw
    assert jpeg.unpack(raw) is raw


def test_an_image_that_would_grow_crosses_as_it_is() -> None:
    tiny = serialize_message(Image(height=1, width=1, encoding="mono8", step=1, data=b"\1"))
    assert jpeg.pack(tiny, QUALITY) is tiny


def test_an_image_that_is_too_wide_for_jpeg_crosses_as_it_is() -> None:
    wide = serialize_message(Image(height=1, width=70_000, encoding="mono8", step=70_000, data=bytes(70_000)))
    assert jpeg.pack(wide, QUALITY) is wide


def test_a_picture_of_another_size_than_its_head_says_is_refused() -> None:
    packed = jpeg.pack(serialize_message(image("rgb8")), QUALITY)
    length = struct.unpack_from("!I", packed, 4)[0]
    other = jpeg.pack(serialize_message(image("mono8")), QUALITY)
    head, picture = packed[: 8 + length], other[8 + struct.unpack_from("!I", other, 4)[0] :]
    larger = head[: 8 + length - 4] + struct.pack("<I", 1 << 30)
    assert len(jpeg.unpack(head + picture)) == length + WIDTH * HEIGHT * 3, "of the right size: colours may lack"
    with pytest.raises(jpeg.JpegError, match="none of an image"):
        jpeg.unpack(larger + picture)


@hypothesis_settings(deadline=None)
@given(st.binary(max_size=300), st.integers(0, 400), st.integers(0, 255))
def test_garbage_is_an_error_or_no_jpeg_of_ours_and_nothing_else(garbage: bytes, place: int, byte: int) -> None:
    packed = bytearray(jpeg.pack(serialize_message(image("rgb8")), QUALITY))
    packed[place % len(packed)] = byte
    for crossed in (bytes(packed), bytes(packed[: place + 4]), jpeg.MAGIC + garbage, garbage):
        try:
            jpeg.unpack(crossed)
        except jpeg.JpegError:
            continue
    assert jpeg.pack(garbage, QUALITY) is garbage
