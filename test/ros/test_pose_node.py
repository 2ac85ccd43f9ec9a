# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node over DDS: inputs, outputs and parameters."""

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros import CalibrationState, DivisionCamera
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.ros.conversions import cloud_msg, division_camera_from_msg, pose_from_msg
from pose_node_client import assert_close, PoseNodeClient, set_parameters
import pytest
import scenes
from sensor_msgs.msg import PointCloud2, RegionOfInterest

pytestmark = pytest.mark.dds


@pytest.fixture(scope='module')
def client(module_peer):
    """One pose_node for the whole module, which must survive all tests."""
    parameters = {'marker.size_m': scenes.MARKER_M}
    return PoseNodeClient(module_peer, parameters=parameters).wait_ready()


def test_a_board_gives_pose_covariance_and_camera(client):
    """With the header of the input, and close to the truth."""
    cloud = scenes.board_cloud(17, 'left_optical')
    pose, with_covariance, camera = client.estimate(cloud)
    for msg in (pose, with_covariance, camera):
        assert msg.header == cloud.header
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    assert with_covariance.pose.pose == pose.pose
    covariance = with_covariance.pose.covariance.reshape(6, 6)
    assert np.linalg.eigvalsh(covariance)[0] >= -1e-12
    assert (camera.width, camera.height) == scenes.SIZE
    assert camera.distortion_model == 'division'
    assert camera.d[0] == pytest.approx(scenes.CAMERA.k, abs=0.01)
    np.testing.assert_allclose(
        camera.k, [520.0, 0.0, 319.5, 0.0, 520.0, 239.5, 0.0, 0.0, 1.0], rtol=0.01
    )
    np.testing.assert_array_equal(camera.r, np.eye(3).ravel())
    p = np.array(camera.p).reshape(3, 4)
    np.testing.assert_array_equal(p[:, :3].ravel(), camera.k)
    np.testing.assert_array_equal(p[:, 3], 0.0)


def test_poses_are_published_in_order_and_none_is_lost(client):
    """30 messages, 30 poses."""
    before = len(client.poses)
    for second in range(100, 130):
        client.cloud.publish(scenes.board_cloud(second))
        client.peer.until(lambda s=second: client.poses and client.poses[-1].header.stamp.sec == s)
    assert [p.header.stamp.sec for p in client.poses[before:]] == list(range(100, 130))


@pytest.mark.parametrize(
    ('order', 'indices'),
    [('aruco_cw_from_top_left', [0, 1, 2, 3]), ('apriltag_ccw_from_bottom_left', [3, 2, 1, 0])],
)
def test_a_marker_has_the_same_pose_in_either_corner_order(client, order, indices):
    """The parameter names the order."""
    client.set('marker.corner_order', order)
    corners = scenes.project(scenes.ARUCO)
    pose, _, camera = client.estimate(scenes.polygon(3, corners[indices], 'tag_camera'))
    assert pose.header.frame_id == 'tag_camera'
    # Four points have several solutions, and any of them may be published. With each, the corners
    # must project to the observed pixels in their order.
    projected = scenes.project(scenes.ARUCO, pose_from_msg(pose), division_camera_from_msg(camera))
    np.testing.assert_allclose(projected, corners, atol=0.1)


def test_the_corner_order_matters(client):
    """Shifting the corners by one rotates the marker by 90 degrees."""
    client.set('marker.corner_order', 'apriltag_ccw_from_bottom_left')
    corners = scenes.project(scenes.ARUCO)
    good, _, _ = client.estimate(scenes.polygon(4, corners[[3, 2, 1, 0]]))
    shifted, _, _ = client.estimate(scenes.polygon(5, corners[[2, 1, 0, 3]]))
    a, b = pose_from_msg(good), pose_from_msg(shifted)
    assert rotation_angle_rad(a.rotation, b.rotation) == pytest.approx(np.pi / 2, abs=1e-3)


def test_a_view_that_does_not_determine_the_distance_gives_no_pose(client):
    """A board parallel to the image: only the covariance is published, and a line is logged."""
    noise_px = np.random.default_rng(0).normal(0.0, 0.3, (len(scenes.GRID), 2))
    image = scenes.project(scenes.GRID, scenes.FACING) + noise_px
    cloud = cloud_msg(scenes.header(50), image, scenes.GRID, np.arange(len(scenes.GRID)))
    before = len(client.poses), len(client.cameras)
    client.cloud.publish(cloud)
    client.peer.until(lambda: client.covariances[-1].header.stamp.sec == 50)
    client.peer.until(lambda: '[not_observable: ' in client.node.output)
    assert (len(client.poses), len(client.cameras)) == before
    result = client.covariances[-1].pose
    assert np.sqrt(result.covariance.reshape(6, 6)[2, 2]) > 0.3 * result.pose.position.z
    client.estimate(scenes.board_cloud(51))


def test_the_centre_is_a_parameter(client):
    """By default it is the middle of the image."""
    client.set('image.center_x_px', 330.0)
    client.set('image.center_y_px', 250.0)
    centred = DivisionCamera(520.0, (330.0, 250.0), -0.2)
    pose, _, camera = client.estimate(scenes.board_cloud(52, camera=centred))
    np.testing.assert_allclose(camera.k[[0, 2, 5]], [520.0, 330.0, 250.0], rtol=1e-4)
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    client.set('image.center_x_px', -1.0)
    client.set('image.center_y_px', -1.0)
    _, _, camera = client.estimate(scenes.board_cloud(53))
    np.testing.assert_allclose(camera.k[[2, 5]], [319.5, 239.5])


def test_a_camera_info_with_another_frame_is_warned_of(peer):
    """The pose is published; a line names both frames."""
    client = PoseNodeClient(peer).wait_ready()
    pose, _, _ = client.estimate(scenes.board_cloud(5, 'another_camera'))
    assert pose.header.frame_id == 'another_camera'
    peer.until(lambda: '[frame_id: ' in client.node.output)
    line = next(line for line in client.lines() if '[frame_id: ' in line)
    assert "'a_camera'" in line
    assert "'another_camera'" in line


def test_without_an_image_size_points_are_rejected(peer):
    """One line names both remedies, and either works."""
    client = PoseNodeClient(peer)
    client.peer.until(
        lambda: '[no_image_size: ' in client.node.output,
        meanwhile=lambda: client.cloud.publish(scenes.board_cloud(5)),
    )
    client.cloud.publish(scenes.board_cloud(6))
    line = next(line for line in client.lines() if '[no_image_size: ' in line)
    for words in ('publish camera_info', 'image.width_px', 'image.height_px', '[WARN]'):
        assert words in line
    assert client.poses == []
    client.set('image.width_px', scenes.SIZE[0])
    client.set('image.height_px', scenes.SIZE[1])
    client.wait_ready(size=None)
    _, _, camera = client.estimate(scenes.board_cloud(7))
    assert (camera.width, camera.height) == scenes.SIZE
    # A camera_info overrides the parameters, and a newer one overrides it.
    for size in ((800, 600), (1024, 768)):
        client.wait_ready(size=size)
        client.peer.until(lambda s=size: _size(client) == s)
        _, _, camera = client.estimate(scenes.board_cloud(8))
        np.testing.assert_allclose(camera.k[2::3][:2], (np.array(size) - 1) / 2)
    assert len([line for line in client.lines() if '[no_image_size: ' in line]) == 1


def _size(client):
    camera = client.estimate(scenes.board_cloud(9))[2]
    return camera.width, camera.height


def test_points_of_a_window_are_converted_to_the_full_image(peer):
    """With binning and region of interest the estimated camera is the same."""
    client = PoseNodeClient(peer)
    info = scenes.camera_info()
    info.binning_x = info.binning_y = 2
    info.roi = RegionOfInterest(x_offset=64, y_offset=32, width=512, height=416)
    full = scenes.project(scenes.GRID)
    sent = (full - [64, 32] + 0.5) / 2.0 - 0.5
    cloud = cloud_msg(scenes.header(3), sent, scenes.GRID, np.arange(len(scenes.GRID)))
    received = (client.poses, client.covariances, client.cameras)

    def publish():
        client.camera_info.publish(info)
        client.cloud.publish(cloud)

    peer.until(lambda: all(received), meanwhile=publish)
    assert_close(pose_from_msg(client.poses[-1]), scenes.CAMERA_FROM_BOARD)
    camera = client.cameras[-1]
    assert (camera.width, camera.height, camera.binning_x) == (*scenes.SIZE, 2)
    assert camera.roi == info.roi
    np.testing.assert_allclose(camera.k[[0, 2, 5]], [520.0, 319.5, 239.5], rtol=1e-4)


def test_without_subscribers_only_self_calibration_estimates(module_peer):
    """In other modes a valid message is only converted."""
    publisher = module_peer.node.create_publisher(PointCloud2, 'unsubscribed/correspondences', 1)
    quiet = module_peer.start(
        'pose_node',
        parameters={
            'intrinsics.mode': 'per_frame',
            'image.width_px': 640,
            'image.height_px': 480,
        },
        remaps=['correspondences:=unsubscribed/correspondences', '__node:=unsubscribed'],
    )
    module_peer.until(publisher.get_subscription_count)
    line = np.column_stack([np.linspace(-0.1, 0.1, 8), np.zeros(8)])
    collinear = cloud_msg(scenes.header(8), scenes.project(line), line, np.arange(8))
    publisher.publish(collinear)
    module_peer.spin_for(0.5)
    assert 'collinear' not in quiet.output
    set_parameters(module_peer, {'intrinsics.mode': 'self_calibrate'}, node='unsubscribed')
    module_peer.until(
        lambda: CalibrationState.CONVERGING.value in quiet.output,
        meanwhile=lambda: publisher.publish(scenes.board_cloud(1)),
    )
    set_parameters(module_peer, {'intrinsics.mode': 'per_frame'}, node='unsubscribed')
    received = module_peer.subscribe(PoseStamped, 'unsubscribed/pose')
    module_peer.until(
        lambda: '[collinear: ' in quiet.output, meanwhile=lambda: publisher.publish(collinear)
    )
    assert received == []
