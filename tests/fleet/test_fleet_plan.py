"""Names and places of a fleet's clips."""

import pytest

from instdrive_core.errors import DataError, OptionError
from instdrive_core.fleet.place import open_place
from instdrive_core.fleet.plan import plan_fleet
from instdrive_core.fleet.records import ClipRecord, FleetAttempt, read_records, write_records


def test_clips_are_named_after_the_end_of_their_path(tmp_path):
    clips = plan_fleet([str(tmp_path / "a 1"), f"file://{tmp_path}/b/", "s3://drives/c.mp4"])
    assert [clip.name for clip in clips] == ["a-1", "b", "c.mp4"]
    assert clips[1].source == str(tmp_path / "b")


def test_equal_ends_are_told_apart_whatever_their_order():
    both = plan_fleet(["s3://one/002", "s3://two/002"])
    assert len({clip.name for clip in both}) == 2
    assert {clip.name for clip in plan_fleet(["s3://two/002", "s3://one/002"])} == {clip.name for clip in both}


@pytest.mark.parametrize("name", ["fleet.json", "index.html", "..."])
def test_no_run_takes_the_name_of_a_file_of_the_fleet(name):
    (clip,) = plan_fleet([f"s3://one/{name}"])
    assert clip.name not in (name, "", ".", "..")


def test_no_clip_and_one_given_twice_are_refused():
    with pytest.raises(OptionError, match="no clips"):
        plan_fleet([])
    with pytest.raises(OptionError, match="given twice"):
        plan_fleet(["s3://one/002", "s3://one/002/"])


def test_reasons_outlive_the_driver(tmp_path):
    place, clips = open_place(str(tmp_path)), plan_fleet(["s3://one/a", "s3://one/b"])
    tried = ClipRecord(clips[0], "running").add_attempt("the worker was lost", 5.0)
    write_records(place, "stopped", [tried, ClipRecord(clips[1], "done")], [{"psnr": None}, {"psnr": 30.0}])
    first, second = read_records(place, clips)
    assert first.attempts == (FleetAttempt(5.0, "the worker was lost"),)
    assert (first.status, second.status) == ("waiting", "waiting")
    with pytest.raises(DataError, match="is of the clip s3://one/a, not of s3://other/a"):
        read_records(place, plan_fleet(["s3://other/a"]))


def test_damaged_records_are_told(tmp_path):
    (tmp_path / "fleet.json").write_text('{"clips": [1]}')
    with pytest.raises(DataError, match=r"fleet\.json: is damaged"):
        read_records(open_place(str(tmp_path)), plan_fleet(["s3://one/a"]))


def test_an_unknown_kind_of_address_is_refused():
    pytest.importorskip("fsspec")
    with pytest.raises(OptionError, match="nowhere://a cannot be opened"):
        open_place("nowhere://a")
