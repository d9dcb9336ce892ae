"""Checkpoints: whole or not there, and only for the run that wrote them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maskfab.base.errors import InputError, OutputError
from maskfab.base.files import load_state, save_state

STATE = {"logits": np.arange(6.0, dtype=np.float32).reshape(2, 3), "notes": np.array(["even start"])}


def test_what_was_saved_comes_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    assert load_state(path, "run") is None
    save_state(path, "run", STATE)
    found = load_state(path, "run")
    assert found is not None
    assert found.keys() == STATE.keys()
    for name, value in STATE.items():
        np.testing.assert_array_equal(found[name], value)
        assert found[name].dtype == value.dtype
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


@pytest.mark.parametrize(
    ("code", "spoil"),
    [
        ("MF303", lambda content: content[: len(content) // 2]),
        ("MF303", lambda content: b""),
        ("MF303", lambda content: b"not a checkpoint"),
        ("MF304", lambda content: content),
    ],
)
def test_refused(tmp_path: Path, code: str, spoil) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "state.npz"
    save_state(path, "one run", STATE)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(InputError) as caught:
        load_state(path, "another run" if code == "MF304" else "one run")
    assert caught.value.code == code
    assert caught.value.cure


def test_a_failed_write_leaves_the_old_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.npz"
    save_state(path, "run", STATE)
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError) as caught:
        save_state(path, "run", {"logits": np.zeros(3)})
    assert caught.value.code == "MF401"
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]
