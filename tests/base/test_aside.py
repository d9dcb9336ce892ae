from __future__ import annotations

import errno

import pytest

from maskfab.base.errors import OutputError
from maskfab.base.files import partial
from maskfab.mask.layout import check_file_size


def test_a_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "x.gbr"
    with partial(path) as aside:
        aside.write_text("half")
        assert not path.exists()
    assert path.read_text() == "half"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_nothing_is_left_of_half_a_file_and_the_old_one_stays(tmp_path, fault):
    path = tmp_path / "x.gbr"
    path.write_text("old")

    def write():
        with partial(path) as aside:
            aside.write_text("half")
            raise fault

    expected = OutputError if isinstance(fault, OSError) else KeyboardInterrupt
    with pytest.raises(expected, match="MF401.*No space left" if expected is OutputError else None):
        write()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_limit_itself_is_allowed(tmp_path):
    check_file_size(10, 10, tmp_path / "x", "")
    with pytest.raises(OutputError, match="MF415"):
        check_file_size(11, 10, tmp_path / "x", "")
