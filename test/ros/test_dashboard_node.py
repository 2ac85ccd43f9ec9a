# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""dashboard_node over DDS: images in, a page, a file, and the camera driver told."""

import json
import re
import struct
import subprocess
import sys
import urllib.error
import urllib.request

import aiohttp
from diagnostic_msgs.msg import DiagnosticArray
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.files.images import read_image
from p4pfr_ros.ros.conversions import image_msg
import pytest
from rendered import CHESSBOARD, write_views
from sensor_msgs.msg import CompressedImage, Image
from sensor_msgs.srv import SetCameraInfo
from std_msgs.msg import Header
from std_srvs.srv import Trigger

pytestmark = pytest.mark.dds


@pytest.fixture(scope='module')
def views(tmp_path_factory):
    """Return paths of rendered views."""
    folder = tmp_path_factory.mktemp('views')
    return write_views(folder, 8)


def start(peer, tmp_path, **parameters):
    """Start the node; return its process and the address of its page."""
    given = {'board_file': CHESSBOARD, 'port': 0, 'calibration_file': tmp_path / 'camera.yaml'}
    node = peer.start('dashboard_node', parameters=given | parameters)
    return node, re.search(r'open (http\S+)', node.output).group(1)


async def state_of(url):
    """Return what the page is told."""
    async with (
        aiohttp.ClientSession() as client,
        client.ws_connect(url.replace('http', 'ws') + 'updates') as page,
    ):
        await page.send_str(json.dumps({'sequence': -1, 'maps': -1}))
        data = await page.receive_bytes(timeout=100.0)
    return json.loads(data[12 : 12 + struct.unpack('>I', data[:4])[0]])


def state(url):
    import asyncio

    return asyncio.run(state_of(url))


def post(url, command):
    with urllib.request.urlopen(urllib.request.Request(url + command, method='POST')) as answer:
        return json.loads(answer.read())['message']


def publish_each(peer, publisher, views, url):
    """Publish images, each when the page shows the one before."""
    for i, path in enumerate(views):
        header = Header(frame_id='camera')
        header.stamp.sec = i + 1
        image = image_msg(header, read_image(path))
        peer.until(
            lambda i=i: state(url)['image']['name'] == f'stamp {i + 1}.000000000',
            meanwhile=lambda image=image: publisher.publish(image),
            every_s=5.0,  # one may be lost while the node follows the QoS of its publisher
        )


def test_a_topic_is_calibrated_and_the_driver_receives_the_camera(peer, views, tmp_path):
    received = []

    def accept(request, response):
        received.append(request.camera_info)
        response.success = True
        return response

    peer.node.create_service(SetCameraInfo, 'set_camera_info', accept)
    diagnostics = peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher = peer.publisher(Image, 'image')
    node, url = start(peer, tmp_path, set_camera_info_service='set_camera_info')
    assert state(url)['source']['state'] == 'waiting'
    peer.until(lambda: publisher.get_subscription_count() == 1)
    publish_each(peer, publisher, views, url)
    shown = state(url)
    assert shown['state'] == 'calibrated'
    assert shown['source'] == {
        'state': 'running',
        'name': f'{peer.namespace}/image',
        'detail': '',
    }
    assert shown['image']['name'] == 'stamp 8.000000000'
    assert post(url, 'save') == f'saved to {tmp_path}/camera.yaml'
    saved = load_calibration(tmp_path / 'camera.yaml').model
    peer.until(lambda: received)
    assert received[0].header.frame_id == 'camera'
    assert list(received[0].d) == list(saved.coefficients)
    peer.until(lambda: any('accepted the calibration' in line for line in [node.output]))
    peer.until(lambda: any('dashboard_node' in m.status[0].name for m in diagnostics if m.status))
    assert peer.call(Trigger, 'dashboard_node/reset_calibration').success
    assert state(url)['state'] == 'uncalibrated'
    saved = peer.call(Trigger, 'dashboard_node/save_calibration')
    assert not saved.success
    assert saved.message.startswith('nothing to save')


def test_the_command_takes_a_topic(peer, views, tmp_path):
    """As p4pfr live --topic, with compressed images."""
    topic = f'{peer.namespace}/camera/image/compressed'
    command = [sys.executable, '-m', 'p4pfr_ros', 'live', '--topic', topic]
    command += ['--board', CHESSBOARD, '--port', '0', '-o', str(tmp_path / 'camera.yaml')]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        line = next(line for line in process.stderr if 'ready: open' in line)
        url = re.search(r'open (http\S+)', line).group(1)
        publisher = peer.publisher(CompressedImage, topic)
        peer.until(lambda: publisher.get_subscription_count() == 1)
        png = views[0].read_bytes()
        # The node may subscribe once more, as its publisher offers: an image may be lost.
        for data, is_shown in (
            (b'nothing', lambda: state(url)['rejected']),
            (png, lambda: state(url)['views'] == 1),
        ):
            image = CompressedImage(format='png', data=data)
            peer.until(
                is_shown, meanwhile=lambda image=image: publisher.publish(image), every_s=5.0
            )
        process.terminate()
        assert process.wait(30.0) == 0
    finally:
        process.kill()
        process.communicate()


def test_without_aiohttp_the_node_says_what_to_install(peer):
    code = "import sys; sys.modules['aiohttp'] = None; "
    code += 'from p4pfr_ros.ros.dashboard_node import main; main()'
    command = [sys.executable, '-c', code, '--ros-args', '-p', f'board_file:={CHESSBOARD}']
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    expected = 'dashboard_node needs aiohttp: install python3-aiohttp'
    assert run.stderr.splitlines()[-1].startswith(expected)
    assert 'Traceback' not in run.stderr


def test_a_port_that_is_taken_is_one_line(peer, tmp_path):
    _, url = start(peer, tmp_path)
    port = int(re.search(r':(\d+)/', url).group(1))
    command = [sys.executable, '-m', 'p4pfr_ros.ros.dashboard_node', '--ros-args']
    command += ['-p', f'board_file:={CHESSBOARD}', '-p', f'port:={port}']
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr.splitlines()[-1].startswith(f'cannot listen on 127.0.0.1:{port}: ')
    assert 'Traceback' not in run.stderr
    with pytest.raises(urllib.error.HTTPError, match='403'):
        urllib.request.urlopen(urllib.request.Request(url, headers={'Host': 'example.org'}))
