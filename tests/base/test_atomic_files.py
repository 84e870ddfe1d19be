"""Files are replaced whole or not at all."""

import os
import resource

import pytest

import dmis
from dmis.base.atomic_files import check_writable, replacing
from dmis.image import check_image


def test_the_old_file_stays_until_the_new_one_is_whole(tmp_path):
    """It is there to the end, it is replaced at once, and after an error it is as it was; nothing else is left."""
    path = tmp_path / "a"
    path.write_text("old")
    with replacing(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    with pytest.raises(OSError, match="No space"), replacing(path) as partial:
        _fail(partial)
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["a"]


def _fail(partial):
    partial.write_text("half")
    raise OSError("No space left on device")


def test_links_and_pipes_are_followed(tmp_path):
    """What a link points to is replaced, not the link; a pipe is written to."""
    path, link, pipe = (tmp_path / name for name in ("a", "link", "pipe"))
    path.write_text("old")
    link.symlink_to(path)
    with replacing(link) as partial:
        partial.write_text("new")
    assert link.is_symlink() and path.read_text() == "new"
    os.mkfifo(pipe)
    check_writable(pipe)
    with replacing(pipe) as partial:
        assert partial == pipe


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_images_are_replaced_atomically(box, tmp_path, name):
    """An image that cannot be written to the end leaves the one before."""
    result = dmis.render(box, "balance", 2)
    path = tmp_path / name
    dmis.write_image(path, result)
    before = path.read_bytes()

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) // 2, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            dmis.write_image(path, result)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before and os.listdir(tmp_path) == [name]


def test_long_names_are_written_and_impossible_ones_refused_first(box, tmp_path):
    """As long as the disk allows; one byte more, and bytes that are not UTF-8, are refused before anything is made."""
    result = dmis.render(box, "balance", 2)
    for end in (".exr", ".png"):
        longest = tmp_path / ("x" * (255 - len(end)) + end)
        check_image(longest)
        dmis.write_image(longest, result)
        with pytest.raises(OSError, match="too long"):
            check_image(tmp_path / f"x{longest.name}")
        with pytest.raises(ValueError, match=r"cannot write b'.*a\\xff\.\w+': its path must be UTF-8"):
            check_image(tmp_path / os.fsdecode(b"a\xff" + end.encode()))
    assert len(os.listdir(tmp_path)) == 2


def test_room_is_compared_with_what_is_free(tmp_path):
    """More than the disk has is refused, with both numbers; nothing is left behind."""
    check_writable(tmp_path / "a", 1000)
    with pytest.raises(OSError, match=r"may need 1000000000000\.0 MB, and .* has [0-9.]+ MB left"):
        check_writable(tmp_path / "a", 10**18)
    assert os.listdir(tmp_path) == []
