"""Pictures and sweeps from a real server are those of the scene, with things where the request places them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from parked_street import CAR, OTHER_CAR

from instdrive_app.main import main
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import OptionError
from instdrive_core.formats.registry import open_scene
from instdrive_core.project.open import open_edited_scene
from instdrive_core.rasterize.rolling_shutter import RollingCamera, view_through_shutter
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.serving.client import SensorClient, build_picture_request
from instdrive_core.serving.messages import find_enum_value, find_message_class
from instdrive_core.serving.requests import RequestError, write_pose
from instdrive_core.serving.server import SensorServer
from instdrive_core.serving.service import open_sensor_service
from instdrive_core.serving.stage import find_object_pose
from instdrive_core.sweeps.drops import BANDS_M, RayDrop

WALL_X = 6.0


def draw(scene, view, time=None):
    color = view_scene(scene, view.camera, view.time if time is None else time).color
    return np.round(np.clip(color, 0, 1) * 255).astype(int)


def apart(left, right):
    """Mean difference of two pictures, of 255."""
    return float(np.abs(left.astype(int) - right.astype(int)).mean())


@pytest.fixture(scope="module")
def scene(service):
    return service.stage.scene


@pytest.fixture(scope="module")
def view(scene):
    return next(each for each in scene.views if each.index == 6 and each.name == "right_camera")


def find_pose(service, name, time):
    return find_object_pose(service.stage.scene, service.stage.things[name].thing, time)


def test_a_picture_is_what_the_scene_shows(client, scene, view):
    assert apart(client.draw(view.camera, view.time), draw(scene, view)) < 0.05


def test_cameras_and_way_lead_back_to_the_photos(client, scene):
    way, cameras = client.fetch_way(), client.list_cameras()
    assert [each.name for each in cameras] == ["front_camera", "right_camera"]
    assert len(way.times) == 12
    for step in (0, 7):
        for camera in cameras:
            view = next(each for each in scene.views if each.index == step and each.name == camera.name)
            mounted = camera.mount(way.world_from_rig[step])
            np.testing.assert_allclose(mounted.world_from_camera, view.camera.world_from_camera, atol=1e-5)
            assert (mounted.fx, mounted.width, mounted.height) == (300, 400, 240)
    pictures = client.draw_rig(list(cameras), way.world_from_rig[7], way.times[7])
    view = next(each for each in scene.views if each.index == 7 and each.name == "right_camera")
    assert apart(pictures["right_camera"], draw(scene, view)) < 0.05


def test_a_parked_thing_stands_where_it_is_placed(client, service, scene, view):
    shift = np.array([-1.0, 2.0, 0.0])
    pose = find_pose(service, str(CAR), view.time)
    unmoved = client.draw(view.camera, view.time, {str(CAR): pose})
    assert apart(unmoved, draw(scene, view)) < 0.1
    document = Document(replace(scene))
    document.apply(MoveInstances((CAR,), tuple(shift.tolist())))
    pose[:3, 3] += shift
    moved = client.draw(view.camera, view.time, {str(CAR): pose})
    assert apart(moved, draw(scene, view)) > 1
    assert apart(moved, draw(bake_document(document), view)) < 0.1


@pytest.mark.parametrize("name", [str(OTHER_CAR), "driven-1", "Car 8"])
def test_a_driving_thing_goes_another_way_by_any_of_its_names(client, service, scene, view, name):
    later = view.time + 0.4
    found = client.draw(view.camera, view.time, {name: find_pose(service, name, later)})
    assert apart(found, draw(scene, view)) > 1
    assert apart(found, draw(scene, view, later)) < 0.1


def test_a_driving_thing_is_there_before_and_after_its_track_where_it_is_placed(client, service, scene, view):
    pose = find_pose(service, "driven-1", view.time)
    gone = client.draw(view.camera, 60.0)
    assert apart(gone, draw(scene, view)) > 1
    assert apart(client.draw(view.camera, 60.0, {"driven-1": pose}), draw(scene, view)) < 0.1


def test_moving_things_that_are_not_named_can_be_gone(street, scene, view):
    service, _ = open_sensor_service(street, unnamed="gone")
    request = build_picture_request(view.camera, view.time)
    request.image_format = find_enum_value("ImageFormat", "RGB_UINT8_PLANAR")
    planes = np.frombuffer(service.render_rgb(request).image_bytes, np.uint8).reshape(3, 240, 400)
    assert apart(planes.transpose(1, 2, 0), draw(scene, view, 60.0)) < 0.05


def test_the_picture_has_the_size_that_the_request_names(client, view):
    request = build_picture_request(view.camera, view.time)
    request.resolution_w, request.resolution_h = 100, 60
    request.image_format, request.image_quality = find_enum_value("ImageFormat", "JPEG"), 80
    packed = client.call("render_rgb", request).image_bytes
    assert packed[:2] == b"\xff\xd8"
    small = client.draw(view.camera.resize(100, 60), view.time)
    assert small.shape == (60, 100, 3)


@pytest.mark.parametrize(
    ("shutter", "direction"),
    [("ROLLING_TOP_TO_BOTTOM", "down"), ("ROLLING_RIGHT_TO_LEFT", "left"), ("GLOBAL", None), ("UNKNOWN", None)],
)
def test_a_rolling_shutter_shows_what_moves_in_the_frame(client, service, scene, view, shutter, direction):
    end = view.camera.world_from_camera.copy()
    end[:3, 3] += [0, 0.6, 0]
    request = build_picture_request(view.camera, view.time)
    request.sensor_pose.end_pose.CopyFrom(write_pose(end))
    request.frame_end_us += 40_000
    request.camera_intrinsics.shutter_type = find_enum_value("ShutterType", shutter)
    middle = end - 0.5 * (end - view.camera.world_from_camera)
    camera = replace(view.camera, world_from_camera=middle)
    if direction is None:
        expected = view_scene(scene, camera, view.time + 0.02).color
    else:
        ends = view.camera.world_from_camera, end, view.time, view.time + 0.04
        expected = view_through_shutter(scene, RollingCamera(camera, *ends, direction)).color
    request.image_format = find_enum_value("ImageFormat", "RGB_UINT8_PLANAR")
    planes = np.frombuffer(client.call("render_rgb", request).image_bytes, np.uint8).reshape(3, 240, 400)
    assert apart(planes.transpose(1, 2, 0), np.round(np.clip(expected, 0, 1) * 255)) < 0.05


def test_a_sweep_has_the_walls_distance_in_the_sensors_axes(client, view):
    pose = np.eye(4)
    pose[:3, 3] = [-1.0, 0.0, 1.8]
    points, intensity = client.sweep((0.0, pose), (0.0, pose))
    assert len(points) == len(intensity) > 1000
    on_wall = (np.abs(points[:, 1]) < 4) & (points[:, 2] > 0.2) & (points[:, 0] > 6)
    assert on_wall.sum() > 100
    np.testing.assert_allclose(np.median(points[on_wall, 0]), WALL_X + 1, atol=0.1)


def test_a_sweep_is_in_the_axes_of_its_end(client):
    start, end = np.eye(4), np.eye(4)
    start[:3, 3], end[:3, 3] = [-1.0, -1.0, 1.8], [0.0, 1.0, 1.8]
    end[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # to the left
    points, _ = client.sweep((0.5, start), (0.6, end))
    world = points @ end[:3, :3].T + end[:3, 3]
    ahead = world[(world[:, 0] > 5) & (world[:, 2] > 1)]
    assert len(ahead) > 100
    np.testing.assert_allclose(np.median(ahead[:, 0]), WALL_X, atol=0.1)


def test_a_placed_thing_returns_light_where_it_is_placed(client, service):
    pose = np.eye(4)
    pose[:3, 3] = [-2.0, 0.0, 1.0]
    car = find_pose(service, str(CAR), 0.0)
    car[:3, 3] = [-2.0, 5.0, 1.0]
    swept = [client.sweep((0.0, pose), (0.1, pose), objects)[0] for objects in ({str(CAR): car}, None)]
    facing = [
        int(((np.abs(found[:, [0, 2]]) < 0.5).all(axis=1) & (found[:, 1] > 1) & (found[:, 1] < 5)).sum())
        for found in swept
    ]
    assert facing[0] > 50
    assert facing[1] == 0


def test_pictures_and_sweeps_come_together(client, view):
    pose = find_message_class("PosePair")()
    request = build_picture_request(view.camera, view.time)
    pose.CopyFrom(request.sensor_pose)
    lidar = find_message_class("LidarRenderRequest")(sensor_pose=pose)
    asked = find_message_class("AggregatedRenderRequest")(rgb_requests=[request] * 2, lidar_requests=[lidar])
    found = client.call("render_aggregated", asked)
    assert len(found.rgb_returns) == 2
    (sweep,) = found.lidar_returns
    assert 3 * sweep.num_points == len(sweep.point_xyzs) == len(sweep.point_xyzs_buffer) // 4


def test_the_scene_names_itself(client, service, view):
    empty = find_message_class("Empty")()
    assert list(client.call("get_available_scenes", empty).scene_ids) == ["street"]
    assert client.call("get_loaded_scenes", empty).scenes[0].scene_id == "street"
    assert client.call("get_version", empty).version_id.startswith("instdrive ")
    assert not client.call("get_available_ego_masks", empty).ego_mask_metadata
    for name in ("street", "*", ""):
        request = build_picture_request(view.camera.resize(20, 12), view.time)
        request.scene_id = name
        assert client.call("render_rgb", request).image_bytes


def test_another_sensor_is_cast_only_where_the_server_was_told(street, service):
    lidar = find_message_class("LidarRenderRequest")()
    lidar.lidar_config.lidar_type = find_enum_value("LidarDeviceType", "AT128")
    for pose in (lidar.sensor_pose.start_pose, lidar.sensor_pose.end_pose):
        pose.quat.w, pose.vec.z = 1.0, 1.8
    with pytest.raises(RequestError, match="lidar_type is AT128; send PANDAR128"):
        service.render_lidar(lidar)
    told, _ = open_sensor_service(street, lidar="VLP-16")
    assert 0 < told.render_lidar(lidar).num_points <= 16 * 1800


def test_surfaces_lose_rays_where_the_server_was_told(street, service):
    lidar = find_message_class("LidarRenderRequest")()
    for pose in (lidar.sensor_pose.start_pose, lidar.sensor_pose.end_pose):
        pose.quat.w, pose.vec.z = 1.0, 1.8
    served = service.lidar.lidar
    half = np.full(len(BANDS_M) + 1, 0.5, np.float32)
    drop = RayDrop(served.find_pattern(0.0), half, np.ones(len(service.stage.scene), np.float32))
    losing = replace(service, lidar=replace(service.lidar, lidar=replace(served, drop=drop)))
    whole, first, again = (each.render_lidar(lidar).num_points for each in (service, losing, losing))
    assert first == again == pytest.approx(whole / 2, rel=0.05)
    with pytest.raises(OptionError, match="no sweeps to learn the ray drop from"):
        open_sensor_service(street, ray_drop=True)


def test_another_rig_is_listed(street, tmp_path):
    file = tmp_path / "rig.json"
    high = {"name": "high", "like": "front_camera", "move_m": [0, 0, 1]}
    file.write_text(json.dumps({"cameras": [high]}))
    service, _ = open_sensor_service(street, cameras=file)
    with SensorServer(service) as server, SensorClient(server.address) as client:
        (camera,) = client.list_cameras()
        way = client.fetch_way()
        own = next(view for view in service.stage.scene.views if view.name == "front_camera" and view.index == 4)
        mounted = camera.mount(way.world_from_rig[4])
        assert camera.name == "high"
        assert np.linalg.norm(mounted.position - own.camera.position) == pytest.approx(1.0, abs=1e-4)
        assert client.draw(mounted, way.times[4]).shape == (240, 400, 3)


def test_a_project_is_served_as_its_edits_make_it(street, tmp_path, view):
    project = tmp_path / "edited.instdrive"
    assert main(["apply", str(street), "--delete", str(CAR), "--move", f"{OTHER_CAR}=1,0,0", "-o", str(project)]) == 0
    service, _ = open_sensor_service(project)
    assert service.name == "edited"
    assert str(CAR) not in service.stage.things
    edited = open_edited_scene(project)
    assert apart(draw(edited, view), draw(open_scene(street), view)) > 2
    with SensorServer(service) as server, SensorClient(server.address) as client:
        assert apart(client.draw(view.camera, view.time), draw(edited, view)) < 0.05
        pose = find_pose(service, str(OTHER_CAR), view.time)
        unmoved = client.draw(view.camera, view.time, {str(OTHER_CAR): pose})
        assert apart(unmoved, draw(edited, view)) < 0.1
