"""Sensor names never leave their folder, and the program accepts them."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from unlidar.names import check_name, folder_names

OUTSIDE = ("../../evil", "/tmp/evil", "..", ".", "", "a/b", "a\\b", "a\0b", "-out", "a b", "ä",
           "x" * 300, "ground_truth", "a\n")  # fmt: skip
NAMES = st.lists(st.text() | st.sampled_from(OUTSIDE) | st.from_regex(r"[a-bA-B_-]{0,3}"))


@pytest.mark.parametrize("text", OUTSIDE)
def test_what_is_no_name_of_a_folder_is_refused(text):
    with pytest.raises(ValueError, match="expected"):
        check_name(text)


@given(NAMES)
def test_any_texts_become_different_names_of_folders_directly_below(texts):
    names = folder_names(texts)
    assert len({name.lower() for name in names}) == len(texts)
    for name in names:
        assert check_name(name) == name
        assert re.fullmatch(r"[A-Za-z0-9_-]+", name)  # NAME of the program's --frames NAME=DIR
        assert (Path("/out") / name).resolve().parent == Path("/out")
    assert folder_names([*texts, "later"])[:-1] == names


def test_a_text_that_is_a_name_stays_as_it_is_and_others_become_like_it():
    assert folder_names(["mid360", "os-1_64"]) == ["mid360", "os-1_64"]
    texts = ["livox/lidar", "livox lidar", "///", "a", "A", "a", "ground_truth"]
    like = ["livox_lidar", "livox_lidar_2", "sensor", "a", "A_2", "a_3", "ground_truth_cloud"]
    assert folder_names(texts) == like
