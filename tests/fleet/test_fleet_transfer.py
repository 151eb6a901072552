"""Clips and runs that have an address."""

import socket
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest
from small_clip import write_small_clip

from instdrive_core.errors import DataError, OptionError
from instdrive_core.fleet import clip_work
from instdrive_core.fleet.clip_work import ClipTask, work_on_clip
from instdrive_core.fleet.figures import is_clip_finished, read_worker_token
from instdrive_core.fleet.hold import hold_place
from instdrive_core.fleet.place import open_place
from instdrive_core.fleet.plan import ClipWishes, plan_fleet
from instdrive_core.fleet.transfer import RunMirror, fetch_source
from instdrive_core.jobs.job_file import JobState, write_job_state

fsspec = pytest.importorskip("fsspec")


@pytest.fixture(scope="session")
def s3_server():
    """An S3 server on this machine alone, with the bucket `drives`; a skip where moto or s3fs is missing."""
    pytest.importorskip("s3fs", reason="s3fs is not installed")
    server_kind = pytest.importorskip("moto.server", reason="moto[server] is not installed").ThreadedMotoServer
    server = server_kind(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            environment.setenv(name, "anything")
        environment.setenv("AWS_DEFAULT_REGION", "us-east-1")
        fsspec.filesystem("s3").mkdir("drives")
        yield
    server.stop()


@pytest.fixture(scope="session")
def gs_server():
    """A server of Google's storage on this machine alone, with the bucket `drives`; a skip where it is missing."""
    pytest.importorskip("gcsfs", reason="gcsfs is not installed")
    create = pytest.importorskip("gcp_storage_emulator.server", reason="gcp-storage-emulator is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = create.create_server("127.0.0.1", port, in_memory=True, default_bucket="drives")
    server.start()
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("STORAGE_EMULATOR_HOST", f"http://127.0.0.1:{port}")
        yield
    server.stop()


@pytest.fixture(params=["memory", "s3", "gs"])
def place(tmp_path, request):
    """A file system with a folder of this test: the system, the folder's address, and its path in the system."""
    if request.param != "memory":
        request.getfixturevalue(f"{request.param}_server")
    bucket = {"memory": "", "s3": "drives/", "gs": "drives/"}[request.param]
    system, path = fsspec.filesystem(request.param), f"{bucket}{tmp_path.name}"
    yield system, f"{request.param}://{path}", path if bucket else f"/{path}"
    system.rm(path, recursive=True)


def test_a_clip_is_fetched_once(place, tmp_path):
    system, address, root = place
    clip = write_small_clip(tmp_path / "clip")
    system.put(str(clip), f"{root}/clip", recursive=True)
    there = fetch_source(f"{address}/clip", tmp_path / "scratch")
    assert there.name == "clip"
    names = {file.relative_to(clip) for file in clip.rglob("*") if file.is_file()}
    assert {file.relative_to(there) for file in there.rglob("*") if file.is_file()} == names
    assert all((clip / name).read_bytes() == (there / name).read_bytes() for name in names)
    system.rm(f"{root}/clip", recursive=True)
    system.pipe_file(f"{root}/keep", b"")
    assert fetch_source(f"{address}/clip", tmp_path / "scratch") == there


def test_one_file_is_fetched(place, tmp_path):
    system, address, root = place
    system.pipe_file(f"{root}/drive.mp4", b"film")
    assert fetch_source(f"{address}/drive.mp4", tmp_path / "scratch").read_bytes() == b"film"


def test_nothing_at_an_address_is_told(place, tmp_path):
    system, address, root = place
    system.pipe_file(f"{root}/other", b"")
    with pytest.raises(DataError, match=r"clip: was not found"):
        fetch_source(f"{address}/clip", tmp_path / "scratch")


def test_a_run_goes_on_on_another_machine(place, tmp_path):
    system, address, root = place
    one, two = RunMirror(f"{address}/run", tmp_path / "one"), RunMirror(f"{address}/run", tmp_path / "two")
    (tmp_path / "one" / "job").mkdir(parents=True)
    (tmp_path / "one" / "checkpoint.safetensors").write_bytes(b"step 100")
    (tmp_path / "one" / "job" / "lock").touch()
    assert one.send(now=True)
    (tmp_path / "one" / "checkpoint.safetensors").write_bytes(b"step 2000")
    assert not one.send()  # not yet due
    two.fetch()
    assert (tmp_path / "two" / "checkpoint.safetensors").read_bytes() == b"step 100"
    assert not (tmp_path / "two" / "job" / "lock").exists()
    one.send(now=True)
    assert system.cat_file(f"{root}/run/checkpoint.safetensors") == b"step 2000"


def test_a_clip_and_its_runs_have_addresses(place, tmp_path, monkeypatch):
    system, address, root = place
    system.put(str(write_small_clip(tmp_path / "clip")), f"{root}/clip", recursive=True)
    asked = []

    def finish(run, request, on_change):
        asked.append(request)
        state = JobState(request, "done")
        write_job_state(run, state)
        on_change(state)
        return state

    monkeypatch.setattr(clip_work, "run_job", finish)
    (clip,), runs = plan_fleet([f"{address}/clip"]), open_place(f"{address}/runs")
    task = ClipTask(clip, ClipWishes(iterations=7), runs.root, str(tmp_path / "scratch"), "token")
    assert work_on_clip(task).status == "done"
    assert asked[0].source.startswith(str(tmp_path / "scratch"))
    assert asked[0].iterations == 7
    assert is_clip_finished(runs, clip, task.wishes)
    assert not is_clip_finished(runs, clip, ClipWishes(record=True))
    assert read_worker_token(runs, clip) == "token"


def test_a_driver_holds_an_address(place):
    """A second one is refused, and finds it free once the first is done."""
    runs = open_place(f"{place[1]}/runs")
    with hold_place(runs), pytest.raises(OptionError, match="another `instdrive fleet` works here"), hold_place(runs):
        pass
    with hold_place(runs) as hold:
        hold.renew()
    assert runs.read("nothing.json") is None


def test_what_others_sent_since_is_seen(place, tmp_path):
    """Though listings of folders are remembered."""
    system, address, root = place
    mirror = RunMirror(f"{address}/run", tmp_path / "one")
    system.pipe_file(f"{root}/run/first", b"1")
    mirror.fetch()
    other = type(system)(skip_instance_cache=True)  # knows nothing of what the first one remembers
    other.pipe_file(f"{root}/run/second", b"2")
    mirror.fetch()
    assert (tmp_path / "one" / "second").read_bytes() == b"2"


@pytest.fixture
def web(tmp_path):
    """A web server on this machine alone that lists the files of a folder."""
    pytest.importorskip("aiohttp", reason="aiohttp is not installed")
    shared = tmp_path / "shared"
    shared.mkdir()

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format, *args):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(shared))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield shared, f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_a_clip_is_fetched_from_a_web_server(web, tmp_path):
    shared, address = web
    clip = write_small_clip(shared / "clip")
    there = fetch_source(f"{address}/clip", tmp_path / "scratch")
    names = {file.relative_to(clip) for file in clip.rglob("*") if file.is_file()}
    assert {file.relative_to(there) for file in there.rglob("*") if file.is_file()} == names
    assert all((clip / name).read_bytes() == (there / name).read_bytes() for name in names)
    (shared / "drive.mp4").write_bytes(b"film")
    assert fetch_source(f"{address}/drive.mp4", tmp_path / "film").read_bytes() == b"film"
    with pytest.raises(DataError, match="nowhere"):
        fetch_source(f"{address}/nowhere", tmp_path / "none")


def test_a_clip_at_fault_is_not_tried_again_and_a_lost_disk_is(tmp_path, monkeypatch):
    (clip,) = plan_fleet([str(tmp_path / "nowhere")])
    task = ClipTask(clip, ClipWishes(), str(tmp_path / "runs"), "", "token")
    outcome = work_on_clip(task)
    assert (outcome.status, outcome.may_repeat) == ("failed", False)
    assert "was not found" in outcome.problem

    def break_down(run, request, on_change):
        raise OSError("disk gone")

    monkeypatch.setattr(clip_work, "run_job", break_down)
    outcome = work_on_clip(task)
    assert (outcome.problem, outcome.may_repeat) == ("OSError: disk gone", True)
