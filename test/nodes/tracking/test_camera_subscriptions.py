"""Cameras as drivers publish them: compressed, best effort or reliable, which is found out."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from tagged_pictures import huge

from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import camera_subscriptions, parameters, qos
from visual_servo_epipolar.nodes.tracker_node import TrackerNode

BEST_EFFORT = qos.IMAGES['best_effort']
STAMP_NS = 5_000_000_007


@pytest.fixture(autouse=True)
def attentive(monkeypatch):
    monkeypatch.setattr(camera_subscriptions, 'LOOK_PERIOD_S', 0.02)


def reliability(node, topic='/image_raw') -> str:
    (subscription,) = (item for item in node.subscriptions if item.topic_name == topic)
    return subscription.qos_profile.reliability.name.lower()


def jpeg(image, stamp_ns=STAMP_NS) -> CompressedImage:
    message = CompressedImage(format='mono8; jpeg compressed ')
    message.header = write.header(stamp_ns, 'camera')
    message.data.frombytes(cv2.imencode('.jpg', image)[1].tobytes())
    return message


@pytest.mark.parametrize('profile', [BEST_EFFORT, qos.STREAM])
def test_any_driver_is_heard_in_the_way_it_offers(bench, simulator, photograph, profile) -> None:
    info = bench.talk(CameraInfo, 'camera_info', profile)
    send, clouds = bench.talk(Image, 'image_raw', profile), bench.listen(PointCloud2, 'tracks')
    node = bench.start(TrackerNode)
    expected = profile.reliability.name.lower()
    for topic in ('/image_raw', '/camera_info'):
        bench.until(lambda topic=topic: reliability(node, topic) == expected, f'{topic} to fit')
    info(write.camera_info(simulator.camera, STAMP_NS, 'camera'))
    bench.settle()
    send(write.image(photograph, 'mono8', STAMP_NS, 'camera'))
    bench.until(lambda: bool(clouds), 'tracks')


@pytest.mark.parametrize('word', ['auto', 'reliable'])
def test_a_camera_info_that_was_latched_before_is_heard(bench, simulator, view, word) -> None:
    info = bench.talk(CameraInfo, 'camera_info', qos.LATCHED)
    info(write.camera_info(simulator.camera, STAMP_NS, 'camera'))
    send, clouds = bench.talk(Image, 'image_raw'), bench.listen(PointCloud2, 'tracks')
    bench.start(TrackerNode, camera_reliability=word)
    send(write.image(view, 'mono8', STAMP_NS, 'camera'))
    bench.until(lambda: bool(clouds), 'tracks, which wait for the camera_info of before')


def test_a_driver_that_is_started_anew_otherwise_is_followed(bench) -> None:
    node = bench.start(TrackerNode)
    bench.pass_time(0.1)  # some looks at no driver
    assert reliability(node) == 'reliable'
    for profile in (BEST_EFFORT, qos.STREAM, BEST_EFFORT):
        publisher = bench.probe.create_publisher(Image, 'image_raw', profile)
        expected = profile.reliability.name.lower()
        bench.until(lambda expected=expected: reliability(node) == expected, 'it to fit')
        bench.probe.destroy_publisher(publisher)
    bench.until(lambda: bench.logged('is published as best_effort, and so subscribed'), 'the log')


def test_of_two_drivers_the_one_that_fits_both_is_taken(bench) -> None:
    bench.talk(Image, 'image_raw', qos.STREAM)
    bench.talk(Image, 'image_raw', BEST_EFFORT)
    node = bench.start(TrackerNode)
    bench.until(lambda: reliability(node) == 'best_effort', 'best effort')


@pytest.mark.parametrize('word', ['reliable', 'best_effort'])
def test_a_reliability_that_is_configured_is_not_found_out(bench, word) -> None:
    other = BEST_EFFORT if word == 'reliable' else qos.STREAM
    node = bench.start(TrackerNode, camera_reliability=word)
    bench.talk(Image, 'image_raw', other)
    for _ in range(5):
        bench.settle()
    assert reliability(node) == word
    assert not bench.logged('and so subscribed')


def test_compressed_images_of_a_topic_that_is_remapped_are_heard(bench) -> None:
    topic = '/cam/image_raw/compressed'
    bench.talk(CompressedImage, topic, BEST_EFFORT)
    node = bench.add(
        TrackerNode(
            context=bench.context,
            cli_args=['--ros-args', '-r', 'image_raw:=/cam/image_raw'],
            parameter_overrides=[parameters.override('transport', 'compressed')],
        )
    )
    bench.until(lambda: reliability(node, topic) == 'best_effort', 'it to fit')


@pytest.mark.parametrize('damage', ['truncated', 'no picture', 'another size', 'empty', 'huge'])
def test_a_broken_picture_is_one_line_no_loss(bench, simulator, photograph, view, damage) -> None:
    clouds = bench.listen(PointCloud2, 'tracks')
    info = bench.talk(CameraInfo, 'camera_info')
    send = bench.talk(CompressedImage, 'image_raw/compressed')
    teach = bench.talk(CompressedImage, 'desired/image_raw/compressed', qos.LATCHED)
    node = bench.start(TrackerNode, transport='compressed')
    teach(jpeg(photograph))
    info(write.camera_info(simulator.camera, STAMP_NS, 'camera'))
    bench.until(lambda: node.ready, 'the photograph')
    bench.settle()
    broken = jpeg(view if damage != 'another size' else np.zeros((120, 160), np.uint8))
    if damage == 'truncated':
        del broken.data[len(broken.data) // 2 :]
    elif damage == 'huge':
        broken = CompressedImage(format='png', data=huge('png'))
    elif damage != 'another size':
        broken = CompressedImage(format='jpeg', data=b'' if damage == 'empty' else b'no picture')
    for message in (jpeg(view, 1), broken, jpeg(view, 3)):
        count = len(clouds)
        send(message)
        bench.until(lambda count=count: len(clouds) > count, 'tracks')
    first, second, third = (read.features(cloud) for cloud in clouds)
    assert len(first) >= 40
    assert len(second) == 0
    assert third.ages.max() == 1  # followed over the gap
    bench.until(lambda: bench.logged('image refused: '), 'the line')
    assert len(bench.logged('image refused: ')) == 1
    assert '\n' not in bench.logged('image refused: ')[0]


COLOR, DEPTH = '/cam/color', '/cam/depth'


@pytest.mark.parametrize(
    ('image', 'info', 'frames', 'doubt'),
    [
        (COLOR, DEPTH, ('color', 'depth'), "of the frames 'color' and 'depth'"),
        (COLOR, COLOR, ('color', 'depth'), "of the frames 'color' and 'depth'"),
        (COLOR, DEPTH, ('color', ''), 'in two namespaces, and no frame_id tells'),
        (COLOR, DEPTH, ('', ''), 'in two namespaces, and no frame_id tells'),
        (COLOR, DEPTH, ('/color', 'color'), ''),
        (COLOR, COLOR, ('', 'color'), ''),
        (COLOR, COLOR, ('', ''), ''),
    ],
)
def test_info_of_another_camera_is_noted(
    bench, simulator, view, image, info, frames, doubt
) -> None:
    clouds = bench.listen(PointCloud2, 'tracks')
    calibrate = bench.talk(CameraInfo, f'{info}/camera_info')
    send = bench.talk(Image, f'{image}/image_raw')
    topics = {'image_raw': f'{image}/image_raw', 'camera_info': f'{info}/camera_info'}
    words = [word for name, to in topics.items() for word in ('-r', f'{name}:={to}')]
    bench.add(TrackerNode(context=bench.context, cli_args=['--ros-args', *words]))
    calibrate(write.camera_info(simulator.camera, STAMP_NS, frames[1]))
    bench.settle()
    for number in range(3):
        send(write.image(view, 'mono8', STAMP_NS + number, frames[0]))
        bench.until(lambda number=number: len(clouds) > number, 'tracks')
    bench.settle()
    said = bench.logged('may be of two cameras')
    assert [doubt in text for text in said] == [True] * bool(doubt)
