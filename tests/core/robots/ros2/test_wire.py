"""What goes over the wire to a robot of ROS 2, byte for byte, and what is refused of what comes from one."""

import math
import struct
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import entity as their_entities
from zenoh_ros2_sdk import qos as their_qos
from zenoh_ros2_sdk.attachment import Attachment as TheirAttachment
from zenoh_ros2_sdk.keyexpr import endpoint_liveliness_keyexpr, node_liveliness_keyexpr, topic_keyexpr

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import DriveError, RobotError
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE, decode_colours, decode_metres, image_size
from ltvn_core.robots.ros2.ros_messages import (
    bumper_message,
    camera_info_message,
    edges_of,
    image_message,
    odometry_message,
    read_odometry,
    read_stamp,
    read_transform,
    read_twist,
    transform_message,
    twist_message,
)
from ltvn_core.robots.ros2.served_robot import compressed_colour_message, compressed_depth_message
from ltvn_core.robots.ros2.topic_keys import (
    BUMPER,
    ODOMETRY,
    TRANSFORMS,
    TWIST,
    TWIST_STAMPED,
    Attachment,
    Role,
    Topic,
    decode,
    encode,
    node_token,
)
from ltvn_core.types import Twist

Them: Any = their_entities
TheirQos: Any = their_qos  # Their decorator hides the fields from type checkers.
STAMP_S = 1_700_000_000.25
GID = bytes(range(16))
TWIST_HASH = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
CAMERA = CameraModel.from_fov(4, 2, math.radians(60))


class Cdr:
    """Little-endian CDR written by hand, as the standard says it: each number begins at a multiple of its size."""

    def __init__(self) -> None:
        self.body = b""

    def put(self, kind: str, *numbers: float) -> "Cdr":
        size = struct.calcsize(kind)
        for number in numbers:
            self.body += b"\0" * (-len(self.body) % size) + struct.pack("<" + kind, number)
        return self

    def text(self, words: str) -> "Cdr":
        self.put("I", len(words) + 1)
        self.body += words.encode() + b"\0"
        return self

    def header(self, frame: str) -> "Cdr":
        return self.put("i", 1_700_000_000).put("I", 250_000_000).text(frame)

    def bytes(self) -> bytes:
        return b"\x00\x01\x00\x00" + self.body


def test_a_twist_is_six_numbers() -> None:
    expected = Cdr().put("d", 0.25, 0, 0, 0, 0, -0.5).bytes()

    assert encode(twist_message(Twist(0.25, -0.5), None)) == expected


def test_a_stamped_twist_has_its_header_before() -> None:
    expected = Cdr().header("base_link").put("d", 0.25, 0, 0, 0, 0, -0.5).bytes()

    assert encode(twist_message(Twist(0.25, -0.5), STAMP_S)) == expected


def test_an_image_is_its_size_encoding_and_pixels() -> None:
    pixels = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    expected = Cdr().header("camera_color_optical_frame").put("I", 2, 2).text("rgb8").put("B", 0).put("I", 6, 12)
    expected.put("B", *range(12))

    assert encode(image_message(pixels, STAMP_S)) == expected.bytes()


def test_a_depth_image_is_floats_in_metres_that_another_library_reads() -> None:
    metres = np.array([[0.5, 1.25, 0.0], [np.nan, 3.0, 9.75]], np.float32)
    expected = Cdr().header("camera_color_optical_frame").put("I", 2, 3).text("32FC1").put("B", 0).put("I", 12, 24)
    expected.put("f", *metres.ravel().tolist())

    assert encode(image_message(metres, STAMP_S)) == expected.bytes()
    theirs: Any = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(expected.bytes(), IMAGE)
    np.testing.assert_array_equal(theirs.data.view(np.float32).reshape(2, 3), metres)


def test_depth_in_millimetres_is_read_from_either_end() -> None:
    for order, is_big in (("<", 0), (">", 1)):
        image = Cdr().header("camera").put("I", 1, 2).text("16UC1").put("B", is_big).put("I", 4, 4)
        image.body += struct.pack(f"{order}2H", 500, 12_000)

        np.testing.assert_allclose(decode_metres(decode(image.bytes(), IMAGE, "/depth"), "/depth"), [[0.5, 12.0]])


def test_compressed_colours_are_a_jpeg_with_its_format_before() -> None:
    message = compressed_colour_message(np.full((48, 64, 3), (200, 100, 30), np.uint8), STAMP_S)
    jpeg = message.data.tobytes()
    expected = Cdr().header("camera_color_optical_frame").text("rgb8; jpeg compressed bgr8").put("I", len(jpeg))
    expected.body += jpeg

    assert encode(message) == expected.bytes()
    assert jpeg[:3] == b"\xff\xd8\xff"
    received = decode(expected.bytes(), COMPRESSED_IMAGE, "/image")
    assert image_size(received, "/image") == (64, 48)
    np.testing.assert_allclose(decode_colours(received, "/image")[20, 20], (200, 100, 30), atol=3)


def test_compressed_depth_is_a_png_of_millimetres_behind_twelve_bytes() -> None:
    metres = np.array([[0.5, 1.25, 0.0], [np.nan, 3.0, 9.75]], np.float32)
    message = compressed_depth_message(metres, STAMP_S)
    data = message.data.tobytes()

    assert (message.format, data[:12], data[12:20]) == ("16UC1; compressedDepth png", bytes(12), b"\x89PNG\r\n\x1a\n")
    received = decode(encode(message), COMPRESSED_IMAGE, "/depth")
    assert image_size(received, "/depth") == (3, 2)
    expected = [[0.5, 1.25, 0.0], [0.0, 3.0, 9.75]]
    np.testing.assert_allclose(decode_metres(received, "/depth", 0.001), expected, rtol=1e-5)
    np.testing.assert_allclose(decode_metres(received, "/depth", 0.0005), np.array(expected) / 2, rtol=1e-5)


def compressed(data: bytes, form: str) -> Any:
    message = compressed_colour_message(np.zeros((2, 2, 3), np.uint8), STAMP_S)
    message.data, message.format = np.frombuffer(data, np.uint8), form
    return message


def test_an_image_that_unpacks_to_too_much_is_refused_before_it_is_decoded() -> None:
    large = cv2.imencode(".png", np.zeros((5000, 5000), np.uint16))[1].tobytes()
    assert len(large) < 100_000
    for data, form in (
        (large, "rgb8; png compressed"),
        (bytes(12) + large, "16UC1; compressedDepth png"),
        (bytes(12) + struct.pack("<II", 5000, 5000) + bytes(8), "16UC1; compressedDepth rvl"),
    ):
        with pytest.raises(DriveError, match="/image: 5000 x 5000 pixels"):
            image_size(compressed(data, form), "/image")


@pytest.mark.parametrize(
    ("data", "form", "message"),
    [
        (b"", "jpeg", "is not an image"),
        (b"no image", "rgb8; jpeg compressed bgr8", "is not an image"),
        (bytes(12), "16UC1; compressedDepth png", "12 bytes are not compressed depth"),
        (bytes(30), "16UC1; compressedDepth png", "is not an image"),
        (bytes(16), "16UC1; compressedDepth rvl", "4 bytes are not compressed depth"),
    ],
)
def test_a_compressed_image_that_is_none_is_refused(data: bytes, form: str, message: str) -> None:
    with pytest.raises(DriveError, match=f"^/image.* {message}"):
        image_size(compressed(data, form), "/image")


def test_colours_where_depth_belongs_are_refused() -> None:
    message = compressed_colour_message(np.zeros((4, 4, 3), np.uint8), STAMP_S)
    with pytest.raises(DriveError, match="/depth is not a depth image"):
        decode_metres(message, "/depth", 0.001)


def test_odometry_is_a_pose_and_speeds_with_their_covariances() -> None:
    expected = Cdr().header("odom").text("base_link")
    expected.put("d", 1.0, 2.0, 0.0, 0.0, 0.0, math.sin(0.25), math.cos(0.25), *[0.0] * 36)
    expected.put("d", 0.3, 0.0, 0.0, 0.0, 0.0, 0.1, *[0.0] * 36)

    message = odometry_message(np.array([1.0, 2.0, 0.5]), Twist(0.3, 0.1), STAMP_S)

    assert encode(message) == expected.bytes()


def test_a_transform_is_a_list_of_one_pose_between_two_frames() -> None:
    expected = Cdr().put("I", 1).header("odom").text("base_link")
    expected.put("d", 1.0, 2.0, 0.0, 0.0, 0.0, math.sin(0.25), math.cos(0.25))
    pose = np.array([1.0, 2.0, 0.5])

    body = encode(transform_message(pose, STAMP_S, "odom", "base_link"))

    assert body == expected.bytes()
    edges = edges_of(decode(body, TRANSFORMS, "/tf"))
    np.testing.assert_allclose(read_transform(edges["odom", "base_link"], "/tf"), pose)


def test_a_touch_is_one_byte() -> None:
    assert encode(bumper_message(pressed=True)) == Cdr().put("B", 1).bytes()
    assert encode(bumper_message(pressed=False)) == Cdr().put("B", 0).bytes()
    assert decode(Cdr().put("B", 1).bytes(), BUMPER, "/bumper").data


def test_camera_info_is_the_lens() -> None:
    focal, middle, level = 2 / math.tan(math.radians(30)), 1.5, 0.5
    expected = Cdr().header("camera_color_optical_frame").put("I", 2, 4).text("plumb_bob").put("I", 5)
    expected.put("d", *[0.0] * 5, focal, 0, middle, 0, focal, level, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1)
    expected.put("d", focal, 0, middle, 0, 0, focal, level, 0, 0, 0, 1, 0)
    expected.put("I", 0, 0, 0, 0, 0, 0).put("B", 0)

    body = encode(camera_info_message(CAMERA, STAMP_S))

    assert body[: len(expected.bytes())].hex() == expected.bytes().hex()
    assert len(body) - len(expected.bytes()) < 4


def test_the_attachment_is_33_bytes_that_another_maker_reads() -> None:
    data = Attachment(7, 1_700_000_000_250_000_000, GID).to_bytes()

    assert data == struct.pack("<q", 7) + struct.pack("<q", 1_700_000_000_250_000_000) + b"\x10" + GID
    theirs = TheirAttachment.from_bytes(data)
    assert (theirs.sequence_id, theirs.timestamp_ns, bytes(theirs.gid)) == (7, 1_700_000_000_250_000_000, GID)
    assert Attachment.from_bytes(theirs.to_bytes(), "/odom") == Attachment(7, 1_700_000_000_250_000_000, GID)


@pytest.mark.parametrize("data", [None, b"", bytes(32), bytes(34), bytes(33), b"\xff" * 16 + b"\x10" + GID])
def test_another_attachment_is_refused_and_the_topic_named(data: bytes | None) -> None:
    with pytest.raises(RobotError, match=r"^/odom: .*rmw_zenoh"):
        Attachment.from_bytes(data, "/odom")


def test_keys_and_tokens_are_those_of_another_maker() -> None:
    topic = Topic("/robot/cmd_vel", TWIST, domain=3)
    ours = topic.token(Role.PUBLISHES, session="ab12", node="ltvn", number=2, best_effort=True)
    node = Them.NodeEntity(domain_id=3, session_id="ab12", node_id=0, node_name="ltvn", namespace="/")
    theirs = Them.EndpointEntity(
        node=node,
        entity_id=2,
        kind=Them.EntityKind.PUBLISHER,
        name="/robot/cmd_vel",
        dds_type_name="geometry_msgs::msg::dds_::Twist_",
        type_hash=TWIST_HASH,
        qos=TheirQos.QosProfile(reliability=TheirQos.QosReliability.BEST_EFFORT, history_depth=1).encode(),
        gid=GID,
    )

    assert topic.key == topic_keyexpr(3, "/robot/cmd_vel", "geometry_msgs::msg::dds_::Twist_", TWIST_HASH)
    assert ours == endpoint_liveliness_keyexpr(theirs)
    assert node_token("ab12", "ltvn", 3) == node_liveliness_keyexpr(node)


def test_a_topic_of_another_type_or_edition_is_named() -> None:
    topic = Topic("/cmd_vel", TWIST)

    topic.check_key(topic.key)
    topic.check_key(topic.key.replace(TWIST_HASH, "TypeHashNotSupported"))
    with pytest.raises(RobotError, match="geometry_msgs/msg/TwistStamped, expected geometry_msgs/msg/Twist"):
        topic.check_key(Topic("/cmd_vel", TWIST_STAMPED).key)
    with pytest.raises(RobotError, match="another version"):
        topic.check_key(topic.key[:-1] + "0")


@pytest.mark.parametrize("damage", [lambda data: data[:20], lambda data: data + bytes(20), lambda data: b"\xff" + data])
def test_a_damaged_message_is_refused(damage: Callable[[bytes], bytes]) -> None:
    with pytest.raises(RobotError, match=r"/cmd_vel: .* are not a geometry_msgs/msg/Twist"):
        decode(damage(encode(twist_message(Twist(0.1, 0.2), None))), TWIST, "/cmd_vel")


def test_what_was_sent_is_what_is_read() -> None:
    pose = np.array([1.0, -2.0, 3.0])
    odometry = decode(encode(odometry_message(pose, Twist(0.0, 0.0), STAMP_S)), ODOMETRY, "/odom")
    command = decode(encode(twist_message(Twist(0.1, -0.2), STAMP_S)), TWIST_STAMPED, "/cmd_vel")

    np.testing.assert_allclose(read_odometry(odometry, "/odom"), pose)
    assert read_stamp(odometry, "/odom") == STAMP_S
    assert read_twist(command, "/cmd_vel") == Twist(0.1, -0.2)


def test_numbers_that_cannot_be_are_refused() -> None:
    with pytest.raises(RobotError, match="two finite speeds"):
        read_twist(twist_message(Twist(math.nan, 0.0), None), "/cmd_vel")
    sideways = twist_message(Twist(0.0, 0.0), None)
    sideways.linear.y = math.nan
    with pytest.raises(RobotError, match="two finite speeds"):
        read_twist(sideways, "/cmd_vel")
    sideways.linear.y = 0.3  # To drop it would make a stop of it.
    with pytest.raises(RobotError, match="refused"):
        read_twist(sideways, "/cmd_vel")
    with pytest.raises(RobotError, match="both must be finite metres"):
        read_odometry(odometry_message(np.array([math.inf, 0.0, 0.0]), Twist(0.0, 0.0), 1.0), "/odom")
    with pytest.raises(RobotError, match="heading"):
        read_odometry(odometry_message(np.array([0.0, 0.0, math.nan]), Twist(0.0, 0.0), 1.0), "/odom")
    with pytest.raises(RobotError, match="not a valid time"):
        read_stamp(image_message(np.zeros((2, 2, 3), np.uint8), -5.0), "/image")


def test_images_come_back_and_another_encoding_is_refused() -> None:
    colours = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    depth = np.array([[1.0, np.nan], [np.inf, 2.5]], np.float32)
    message = decode(encode(image_message(colours, STAMP_S)), IMAGE, "/image")

    np.testing.assert_array_equal(decode_colours(message, "/image"), colours)
    np.testing.assert_array_equal(decode_metres(image_message(depth, 1.0), "/depth"), [[1.0, 0.0], [0.0, 2.5]])
    with pytest.raises(DriveError, match="/depth: the encoding 'rgb8' is not one of"):
        decode_metres(message, "/depth")


def test_a_lens_comes_back() -> None:
    info = decode(encode(camera_info_message(CAMERA, STAMP_S)), CAMERA_INFO, "/camera_info")

    assert (info.width, info.height, info.distortion_model) == (4, 2, "plumb_bob")
    np.testing.assert_allclose(info.k[0], CAMERA.fx)
