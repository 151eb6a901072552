"""Requests that cannot be answered are refused by field, value and remedy, and the server goes on."""

import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import grpc
import numpy as np
import pytest

from instdrive_app.main import main
from instdrive_core.serving import messages
from instdrive_core.serving.client import SensorClient, build_picture_request
from instdrive_core.serving.messages import SERVICE, find_message_class
from instdrive_core.serving.requests import Limits, Rate, TooFastError
from instdrive_core.serving.server import SensorServer
from instdrive_core.serving.service import open_sensor_service

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def picture(service):
    view = service.stage.scene.views[0]
    return build_picture_request(view.camera.resize(40, 24), view.time)


def fisheye(shutter=0, side=0, **values):
    """Put a fisheye into a request, with some of its fields set."""

    def change(request):
        spec = request.camera_intrinsics
        fields = {"principal_point_x": 20.0, "principal_point_y": 12.0, "focal_length_x": 15.0, "focal_length_y": 15.0}
        spec.opencv_fisheye_param.MergeFrom(find_message_class("OpenCVFisheyeCameraParam")(**(fields | values)))
        spec.shutter_type = shutter
        if side:
            request.resolution_w = request.resolution_h = side

    return change


def ftheta(cde=None, **values):
    """Put an f-theta lens into a request, with some of its fields set."""

    def change(request):
        lens = request.camera_intrinsics.ftheta_param
        fields = {"principal_point_x": 20.0, "principal_point_y": 12.0}
        lens.MergeFrom(find_message_class("FthetaCameraParam")(**(fields | values)))
        if cde is not None:
            lens.linear_cde.linear_c, lens.linear_cde.linear_d, lens.linear_cde.linear_e = cde

    return change


def add_objects(request, *names):
    for name in names:
        request.dynamic_objects.add(track_id=name).pose_pair.CopyFrom(request.sensor_pose)


def spoil(**values):
    """Set fields, given with __ for the dots."""

    def change(request):
        for name, value in values.items():
            *parents, last = name.split("__")
            target = request
            for parent in parents:
                target = getattr(target, parent)
            if isinstance(value, list):
                getattr(target, last).extend(value)
            else:
                setattr(target, last, value)

    return change


LENS = "camera_intrinsics__opencv_pinhole_param__"
BAD = {
    "a path as the scene": (spoil(scene_id="/etc/passwd"), "scene_id is '/etc/passwd'; send 'street'"),
    "no pose": (lambda request: request.ClearField("sensor_pose"), "sensor_pose.start_pose is missing; send both"),
    "half a pose": (lambda request: request.sensor_pose.ClearField("end_pose"), "sensor_pose.end_pose is missing"),
    "no turn": (spoil(sensor_pose__start_pose__quat__w=50.0), "sensor_pose.start_pose.quat is (50"),
    "nowhere": (spoil(sensor_pose__end_pose__vec__y=float("nan")), "sensor_pose.end_pose.vec.y is nan; send a number"),
    "far away": (spoil(sensor_pose__end_pose__vec__x=1e30), "sensor_pose.end_pose.vec.x is 1e+30; send a number"),
    "no lens": (
        lambda request: request.ClearField("camera_intrinsics"),
        "camera_param is missing; send opencv_pinhole_param, o",
    ),
    "rolling fisheye": (fisheye(shutter=1), "shutter_type is ROLLING_TOP_TO_BOTTOM; send GLOBAL, or opencv_pinhole"),
    "fisheye without a focal length": (fisheye(focal_length_x=0.0), "opencv_fisheye_param.focal_length_x is 0; send a"),
    "fisheye of no angle": (fisheye(max_angle=-1.0), "opencv_fisheye_param.max_angle is -1; send a number from 0.01"),
    "fisheye of nothing": (fisheye(principal_point_x=80.0, max_angle=0.01), "no pixel sees anything; send another one"),
    "large fisheye": (fisheye(side=2400), "is 5,760,000 pixels; a picture of this lens may have 4,000,000 pixels"),
    "f-theta of nothing": (ftheta(), "ftheta_param.angle_to_pixeldist_poly is empty; send angle_to_pixeldist_poly"),
    "f-theta of no number": (ftheta(angle_to_pixeldist_poly=[0.0, float("nan")]), "pixeldist_poly[1] is nan; send a"),
    "f-theta of many": (ftheta(pixeldist_to_angle_poly=[0.1] * 17), "pixeldist_to_angle_poly is 17 long; send at most"),
    "flat f-theta": (
        ftheta(angle_to_pixeldist_poly=[0.0, 20.0], cde=(1, 1, 1)),
        "linear_cde is (1, 1, 1); send numbers",
    ),
    "windshield": (
        lambda request: request.camera_intrinsics.bivariate_windshield_model_param.SetInParent(),
        "external_distortion is a windshield; leave it out",
    ),
    "no focal length": (spoil(**{LENS + "focal_length_x": 0.0}), "focal_length_x is 0; send a number from 1"),
    "infinite": (spoil(**{LENS + "focal_length_y": float("inf")}), "focal_length_y is inf; send a number"),
    "off the picture": (spoil(**{LENS + "principal_point_x": 1e9}), "principal_point_x is 1e+09; send a number"),
    "no width": (spoil(camera_intrinsics__resolution_w=0), "camera_intrinsics.resolution_w is 0; send a number from 8"),
    "huge": (spoil(resolution_w=2**31), "resolution_w is 2.14748e+09; send a number from 8 to 8192"),
    "large": (spoil(resolution_w=8000, resolution_h=8000), "is 64,000,000 pixels; a request may ask for 16,000,000"),
    "another clock": (spoil(frame_start_us=2**60, frame_end_us=2**60), "count microseconds from the drive's first"),
    "backwards": (spoil(frame_start_us=500_000), "frame_end_us is 0; send frame_start_us = 500000"),
    "endless": (spoil(frame_end_us=2**62), "frame_end_us is 4611686018427387904; send frame_start_us = 0"),
    "a film": (spoil(image_format=6), "image_format is AV1; send PNG, JPEG, RGB_UINT8_PLANAR"),
    "unknown format": (spoil(image_format=99), "image_format is 99; send PNG"),
    "quality": (spoil(image_quality=101.0), "image_quality is 101; send a number from 1 to 100"),
    "shutter": (
        spoil(camera_intrinsics__shutter_type=77),
        "camera_intrinsics.shutter_type is 77; send GLOBAL, ROLLING",
    ),
    "ego mask": (spoil(insert_ego_mask=True), "insert_ego_mask is true; send false"),
    "no such thing": (lambda request: add_objects(request, "a" * 500), "dynamic_objects[0].track_id is 'aaaa"),
    "nothing": (lambda request: add_objects(request, "0"), "is '0'; name a thing by the editor's ID ("),
    "twice": (lambda request: add_objects(request, "7", "Car 7"), "[1].track_id is 'Car 7'; name each thing once"),
    "crowd": (lambda request: add_objects(request, *["7"] * 1001), "dynamic_objects is 1001 objects long; send at"),
    "no pose of a thing": (
        lambda request: request.dynamic_objects.add(track_id="7"),
        "dynamic_objects[0].pose_pair.start_pose is missing",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_drawn_is_refused_by_name(client, picture, case):
    change, message = BAD[case]
    change(picture)
    with pytest.raises(grpc.RpcError) as caught:
        client.call("render_rgb", picture)
    assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert message in caught.value.details()
    assert len(caught.value.details()) < 300


def test_after_all_that_it_still_draws(client, service, picture):
    assert len(client.call("render_rgb", picture).image_bytes) > 100


def test_long_lists_of_pictures_are_refused(client, picture):
    batch = find_message_class("BatchRGBRenderRequest")()
    for _ in range(65):
        batch.items.add(request=picture)
    with pytest.raises(grpc.RpcError, match="items is 65 long; send at most 64"):
        client.call("batch_render_rgb", batch)
    both = find_message_class("AggregatedRenderRequest")(rgb_requests=[picture] * 65)
    with pytest.raises(grpc.RpcError, match="rgb_requests and lidar_requests is 65 long; send at most 64"):
        client.call("render_aggregated", both)


def test_sweeps_are_checked_alike(client):
    request = find_message_class("LidarRenderRequest")(scene_id="other")
    for field in ("scene_id", "sensor_pose.start_pose"):
        with pytest.raises(grpc.RpcError, match=f"{field} is ") as caught:
            client.call("render_lidar", request)
        assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
        request.scene_id = ""


def send_bytes(server, sent):
    with grpc.insecure_channel(server.address, options=[("grpc.enable_http_proxy", 0)]) as channel:
        return channel.unary_unary(f"/{SERVICE}/render_rgb")(sent, timeout=20)


def test_bytes_that_are_no_message_are_refused(server, picture):
    rng = np.random.default_rng(3)
    whole = picture.SerializeToString()
    for sent in (b"\xff" * 50, whole[:-3], rng.bytes(2000)):
        with pytest.raises(grpc.RpcError) as caught:
            send_bytes(server, sent)
        assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
        assert "that are no RGBRenderRequest" in caught.value.details()
    assert send_bytes(server, whole)


def test_damaged_messages_never_end_the_server(server, picture):
    rng = np.random.default_rng(7)
    whole = np.frombuffer(picture.SerializeToString(), np.uint8)
    codes = set()
    for _ in range(60):
        damaged = whole.copy()
        damaged[rng.integers(0, len(whole), 3)] = rng.integers(0, 256, 3)
        try:
            send_bytes(server, damaged.tobytes())
        except grpc.RpcError as error:
            codes.add(error.code())
    assert codes == {grpc.StatusCode.INVALID_ARGUMENT}
    assert send_bytes(server, whole.tobytes())


def test_a_message_beyond_the_limit_is_refused_unread(server, picture):
    picture.scene_id = "x" * (2 << 20)
    with pytest.raises(grpc.RpcError) as caught:
        send_bytes(server, picture.SerializeToString())
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED


def test_too_many_requests_at_once_are_refused(service, monkeypatch):
    begun, go_on = threading.Event(), threading.Event()

    def wait(_self, _request):
        begun.set()
        assert go_on.wait(20)
        return find_message_class("VersionId")()

    monkeypatch.setattr(type(service), "get_version", wait)
    few, empty = service.with_limits(Limits(requests=1)), find_message_class("Empty")()
    with SensorServer(few) as server, SensorClient(server.address) as client:
        first = threading.Thread(target=client.call, args=("get_version", empty))
        first.start()
        assert begun.wait(20)
        with pytest.raises(grpc.RpcError) as caught:
            client.call("get_version", empty)
        go_on.set()
        first.join()
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED


def test_pixels_and_rays_have_a_rate():
    now = [0.0]
    rate = Rate(Limits(pixels=500, rate=1000), lambda: now[0])
    rate.take(1000)
    with pytest.raises(TooFastError, match=r"1,000 pixels and rays a second; ask again in 0\.3 s"):
        rate.take(300)
    now[0] = 0.3
    rate.take(300)
    now[0] = 99.0
    rate.take(1000)
    with pytest.raises(TooFastError):
        rate.take(1)
    slow = Rate(Limits(pixels=500, rate=100), lambda: now[0])
    slow.take(500)


def test_a_client_beyond_the_rate_is_told_and_served_later(service, picture):
    now, limits = [0.0], Limits(pixels=40 * 24, rate=40 * 24)
    slow = replace(service.with_limits(limits), rate=Rate(limits, lambda: now[0]))
    with SensorServer(slow) as server, SensorClient(server.address) as client:
        assert client.call("render_rgb", picture).image_bytes
        with pytest.raises(grpc.RpcError) as caught:
            client.call("render_rgb", picture)
        assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        assert "ask again in 1.0 s" in caught.value.details()
        now[0] = 1.0
        assert client.call("render_rgb", picture).image_bytes
    lidar = find_message_class("LidarRenderRequest")(sensor_pose=picture.sensor_pose)
    with pytest.raises(TooFastError):
        slow.render_lidar(lidar)


def test_a_fault_of_the_server_is_its_own_and_tells_no_paths(service, monkeypatch, caplog):
    def fail(_self, _request):
        raise OSError("/secret/place")

    monkeypatch.setattr(type(service), "get_version", fail)
    with SensorServer(service) as server, SensorClient(server.address) as client:
        with pytest.raises(grpc.RpcError) as caught:
            client.call("get_version", find_message_class("Empty")())
        assert client.list_cameras()
    assert caught.value.code() == grpc.StatusCode.INTERNAL
    assert "secret" not in caught.value.details()
    assert "/secret/place" in caplog.text


def test_a_taken_port_and_wrong_options_are_told(server, street, capsys):
    assert main(["serve", str(street), "--port", str(server.port)]) == 2
    assert f"127.0.0.1:{server.port} cannot be listened at" in capsys.readouterr().err
    assert main(["serve", str(street), "--port", "70000"]) == 2
    assert "--port is 70000" in capsys.readouterr().err
    assert main(["serve", str(street), "--max-requests", "0"]) == 2
    assert "--max-requests is 0" in capsys.readouterr().err
    assert main(["serve", str(street), "--lidar", "nothing"]) == 2
    assert "'nothing' is neither a file nor one of the sensors" in capsys.readouterr().err


def test_sigint_ends_the_command_cleanly(street):
    command = [sys.executable, "-c", "import sys; from instdrive_app.main import main; sys.exit(main())"]
    running = subprocess.Popen(
        [*command, "serve", str(street), "--port", "0"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        line = next(text for text in running.stdout if text.startswith("serving"))
        with SensorClient(line.split()[3].rstrip(";")) as client:
            assert len(client.list_cameras()) == 2
        for _ in range(2):  # an impatient user presses it twice
            running.send_signal(signal.SIGINT)
        out, error = running.communicate(timeout=30)
    finally:
        running.kill()
    assert (running.returncode, error) == (0, "")
    assert out.splitlines()[-1] == "stopping"


def test_the_compiled_messages_are_those_of_the_proto(tmp_path):
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from grpc_tools import protoc

    folder, compiled = Path(messages.__file__).parent, tmp_path / "again.binpb"
    arguments = ["protoc", f"-I{folder}", f"--descriptor_set_out={compiled}", "sensorsim.proto"]
    assert protoc.main(arguments) == 0
    assert FileDescriptorSet.FromString(compiled.read_bytes()) == FileDescriptorSet.FromString(
        (folder / "sensorsim.binpb").read_bytes()
    )


def test_opening_again_serves_the_same_scene(street, service):
    again, notes = open_sensor_service(street)
    assert (again.name, again.last) == (service.name, service.last) == ("street", pytest.approx(1.1))
    assert "intensity is 0" in notes[0]
