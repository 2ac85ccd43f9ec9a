# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node over DDS: what goes in, what comes out, and what it survives."""

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.ros.conversions import cloud_msg, division_camera_from_msg, pose_from_msg
import pytest
import scenes
from sensor_msgs.msg import PointCloud2, RegionOfInterest
from talk import assert_close, set_parameters, Talk

pytestmark = pytest.mark.dds


@pytest.fixture(scope='module')
def talk(module_peer):
    """One pose_node for the whole module: it has to survive all of its tests."""
    parameters = {'marker.size_m': scenes.MARKER_M}
    return Talk(module_peer, parameters=parameters).open()


def test_a_board_is_answered_with_header_pose_covariance_and_camera(talk):
    """Every output carries the header of its input, and the truth."""
    asked = scenes.board_cloud(17, 'left_optical')
    pose, with_covariance, camera = talk.ask(asked)
    for answer in (pose, with_covariance, camera):
        assert answer.header == asked.header
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    assert with_covariance.pose.pose == pose.pose
    covariance = with_covariance.pose.covariance.reshape(6, 6)
    assert np.linalg.eigvalsh(covariance)[0] >= -1e-12
    assert (camera.width, camera.height) == scenes.SIZE
    assert camera.distortion_model == 'division'
    np.testing.assert_allclose(camera.d, [scenes.CAMERA.k], atol=1e-4)
    np.testing.assert_allclose(
        camera.k, [520.0, 0.0, 319.5, 0.0, 520.0, 239.5, 0.0, 0.0, 1.0], rtol=1e-4
    )
    np.testing.assert_array_equal(camera.r, np.eye(3).ravel())
    p = np.array(camera.p).reshape(3, 4)
    np.testing.assert_array_equal(p[:, :3].ravel(), camera.k)
    np.testing.assert_array_equal(p[:, 3], 0.0)


def test_answers_come_in_order_and_none_is_lost(talk):
    """Thirty boards, thirty answers."""
    before = len(talk.poses)
    for second in range(100, 130):
        talk.cloud.publish(scenes.board_cloud(second))
        talk.peer.until(lambda s=second: talk.poses and talk.poses[-1].header.stamp.sec == s)
    assert [p.header.stamp.sec for p in talk.poses[before:]] == list(range(100, 130))


@pytest.mark.parametrize(
    ('order', 'indices'),
    [('aruco_cw_from_top_left', [0, 1, 2, 3]), ('apriltag_ccw_from_bottom_left', [3, 2, 1, 0])],
)
def test_a_marker_has_the_same_pose_in_either_corner_order(talk, order, indices):
    """A corner goes by the place that the order gives it."""
    talk.set('marker.corner_order', order)
    corners = scenes.seen(scenes.ARUCO)
    pose, _, camera = talk.ask(scenes.polygon(3, corners[indices], 'tag_camera'))
    assert pose.header.frame_id == 'tag_camera'
    # Four points leave several solutions, and which is true cannot be told from them. Whichever
    # it is, the marker's corners, each by its name, must fall where they were seen.
    again = scenes.seen(scenes.ARUCO, pose_from_msg(pose), division_camera_from_msg(camera))
    np.testing.assert_allclose(again, corners, atol=1e-2)


def test_the_corner_order_matters(talk):
    """Shifting the corners by one turns the marker by a right angle."""
    talk.set('marker.corner_order', 'apriltag_ccw_from_bottom_left')
    corners = scenes.seen(scenes.ARUCO)
    good, _, _ = talk.ask(scenes.polygon(4, corners[[3, 2, 1, 0]]))
    turned, _, _ = talk.ask(scenes.polygon(5, corners[[2, 1, 0, 3]]))
    # One corner further on: the marker, square as it is, is seen turned by a right angle.
    a, b = pose_from_msg(good), pose_from_msg(turned)
    assert rotation_angle_rad(a.rotation, b.rotation) == pytest.approx(np.pi / 2, abs=1e-3)


def test_a_view_that_does_not_tell_the_distance_gives_no_pose(talk):
    """A board parallel to the image: the covariance says it, and a line; nothing is made up."""
    noise_px = np.random.default_rng(0).normal(0.0, 0.3, (len(scenes.GRID), 2))
    image = scenes.seen(scenes.GRID, scenes.FACING) + noise_px
    cloud = cloud_msg(scenes.header(50), image, scenes.GRID, np.arange(len(scenes.GRID)))
    before = len(talk.poses), len(talk.cameras)
    talk.cloud.publish(cloud)
    talk.peer.until(lambda: talk.covariances[-1].header.stamp.sec == 50)
    talk.peer.until(lambda: '[not_observable: ' in talk.node.output)
    assert (len(talk.poses), len(talk.cameras)) == before
    answer = talk.covariances[-1].pose
    assert np.sqrt(answer.covariance.reshape(6, 6)[2, 2]) > 0.3 * answer.pose.position.z
    talk.ask(scenes.board_cloud(51))


def test_the_optical_centre_can_be_given(talk):
    """The camera's centre is the parameter's, and the middle again when that is taken back."""
    talk.set('image.center_x_px', 330.0)
    talk.set('image.center_y_px', 250.0)
    centred = DivisionCamera(520.0, (330.0, 250.0), -0.2)
    pose, _, camera = talk.ask(scenes.board_cloud(52, camera=centred))
    np.testing.assert_allclose(camera.k[[0, 2, 5]], [520.0, 330.0, 250.0], rtol=1e-4)
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    talk.set('image.center_x_px', -1.0)
    talk.set('image.center_y_px', -1.0)
    _, _, camera = talk.ask(scenes.board_cloud(53))
    np.testing.assert_allclose(camera.k[[2, 5]], [319.5, 239.5])


def test_another_cameras_camera_info_is_remarked_upon(peer):
    """It may be right, so the answer comes; but a line names both frames."""
    talk = Talk(peer).open()
    pose, _, _ = talk.ask(scenes.board_cloud(5, 'another_camera'))
    assert pose.header.frame_id == 'another_camera'
    peer.until(lambda: '[frame_id: ' in talk.node.output)
    line = next(line for line in talk.lines() if '[frame_id: ' in line)
    assert "'a_camera'" in line
    assert "'another_camera'" in line


def test_without_the_size_of_the_picture_it_says_what_to_do(peer):
    """One line that names both ways out; then the answers come, by either of them."""
    talk = Talk(peer)
    talk.peer.until(
        lambda: '[no_image_size: ' in talk.node.output,
        meanwhile=lambda: talk.cloud.publish(scenes.board_cloud(5)),
    )
    talk.cloud.publish(scenes.board_cloud(6))
    line = next(line for line in talk.lines() if '[no_image_size: ' in line)
    for words in ('publish camera_info', 'image.width_px', 'image.height_px', '[WARN]'):
        assert words in line
    assert talk.poses == []
    talk.set('image.width_px', scenes.SIZE[0])
    talk.set('image.height_px', scenes.SIZE[1])
    talk.open(size=None)
    _, _, camera = talk.ask(scenes.board_cloud(7))
    assert (camera.width, camera.height) == scenes.SIZE
    # A camera_info knows better than the parameters, and a newer one than an older one.
    for size in ((800, 600), (1024, 768)):
        talk.open(size=size)
        talk.peer.until(lambda s=size: _size(talk) == s)
        _, _, camera = talk.ask(scenes.board_cloud(8))
        np.testing.assert_allclose(camera.k[2::3][:2], (np.array(size) - 1) / 2)
    assert len([line for line in talk.lines() if '[no_image_size: ' in line]) == 1


def _size(talk):
    camera = talk.ask(scenes.board_cloud(9))[2]
    return camera.width, camera.height


def test_corners_of_a_window_are_those_of_the_full_picture(peer):
    """Binning and region of interest are the driver's business; the camera stays the same."""
    talk = Talk(peer)
    info = scenes.camera_info()
    info.binning_x = info.binning_y = 2
    info.roi = RegionOfInterest(x_offset=64, y_offset=32, width=512, height=416)
    full = scenes.seen(scenes.GRID)
    sent = (full - [64, 32] + 0.5) / 2.0 - 0.5
    cloud = cloud_msg(scenes.header(3), sent, scenes.GRID, np.arange(len(scenes.GRID)))
    heard = (talk.poses, talk.covariances, talk.cameras)

    def say():
        talk.camera_info.publish(info)
        talk.cloud.publish(cloud)

    peer.until(lambda: all(heard), meanwhile=say)
    assert_close(pose_from_msg(talk.poses[-1]), scenes.CAMERA_FROM_BOARD)
    camera = talk.cameras[-1]
    assert (camera.width, camera.height, camera.binning_x) == (*scenes.SIZE, 2)
    assert camera.roi == info.roi
    np.testing.assert_allclose(camera.k[[0, 2, 5]], [520.0, 319.5, 239.5], rtol=1e-4)


def test_nothing_is_computed_for_nobody_but_the_camera(module_peer):
    """Without a subscriber, a good message costs its conversion only; self-calibration goes on."""
    publisher = module_peer.node.create_publisher(PointCloud2, 'unheard/correspondences', 1)
    quiet = module_peer.start(
        'pose_node',
        parameters={
            'intrinsics.mode': 'per_frame',
            'image.width_px': 640,
            'image.height_px': 480,
        },
        remaps=['correspondences:=unheard/correspondences', '__node:=unheard'],
    )
    module_peer.until(publisher.get_subscription_count)
    line = np.column_stack([np.linspace(-0.1, 0.1, 8), np.zeros(8)])
    useless = cloud_msg(scenes.header(8), scenes.seen(line), line, np.arange(8))
    publisher.publish(useless)
    module_peer.quiet(0.5)
    assert 'collinear' not in quiet.output
    set_parameters(module_peer, {'intrinsics.mode': 'self_calibrate'}, node='unheard')
    module_peer.until(
        lambda: 'calibration: the camera is known roughly' in quiet.output,
        meanwhile=lambda: publisher.publish(scenes.board_cloud(1)),
    )
    set_parameters(module_peer, {'intrinsics.mode': 'per_frame'}, node='unheard')
    heard = module_peer.listen(PoseStamped, 'unheard/pose')
    module_peer.until(
        lambda: '[collinear: ' in quiet.output, meanwhile=lambda: publisher.publish(useless)
    )
    assert heard == []
