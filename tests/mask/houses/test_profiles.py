"""Profiles of mask houses: facts with their pages, and nothing unknown in them."""

from __future__ import annotations

import json
import tomllib

import pytest
from pydantic import ValidationError
from small_job import command

from maskfab.base import resources
from maskfab.base.errors import OutputError
from maskfab.job.shop import parse_shop
from maskfab.mask.houses.profiles import load_shop, shop_names

LEAST = 'title = "A house"\nsources = []\n[order]\nfields = ["tone"]\n'


@pytest.mark.parametrize("name", shop_names())
def test_every_profile_has_its_pages_and_says_something_that_can_be_broken(name):
    shop = load_shop(name)
    assert shop.name == name
    assert all(source.startswith("http") for source in shop.sources)
    assert shop.sources
    assert shop.read_on is not None
    published = shop.model_dump(exclude_none=True, exclude={"order", "name", "title", "sources"})
    assert any(published[section] for section in ("accepts", "limits", "plate", "names"))


@pytest.mark.parametrize("name", shop_names())
def test_keys_that_are_not_from_the_house_are_keys_of_the_profile(name):
    text = resources.template(f"shops/{name}.toml")
    stated = tomllib.loads(text)
    for key in load_shop(name).third_party:
        section, entry = key.split(".")
        assert entry in stated[section]


def test_what_is_not_said_is_not_published():
    shop = parse_shop(LEAST, "mine", where="mine.toml")
    assert shop.limits.min_feature_um is None
    assert shop.accepts.formats is None
    assert shop.formats == ("gdsii", "dxf_r12")


def test_a_profile_cannot_be_changed():
    with pytest.raises(ValidationError):
        load_shop("gesim").title = "another"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("[limits]\nmin_featur_um = 1.0\n", "min_featur_um"),
        ("[limits]\nmin_feature_um = -1.0\n", "min_feature_um"),
        ("[limits]\nmin_feature_um = nan\n", "min_feature_um"),
        ('[limits]\nmin_feature_um = "1 um"\n', "min_feature_um"),
        ("[limits]\nmax_vertices = 0\n", "max_vertices"),
        ('[accepts]\nformats = ["dwg"]\n', "formats"),
        ("[accepts]\nformats = []\n", "formats"),
        ('[names]\npattern = "["\n', "pattern"),
        ('[names]\nlayers = { METAL = "A" }\n', "no such layer"),
        ('[names]\nlayers = { CLEAR = "0" }\n', "no name for a layer"),
        ('[names]\nlayers = { CLEAR = "A B" }\n', "no name for a layer"),
        ('[names]\npattern = "[A--Z]"\n', "pattern"),
        ("[plate]\nplot_area_mm = [100.0]\n", "plot_area_mm"),
        ('[strange]\nkey = "value"\n', "strange"),
        ("limits =", "TOML"),
    ],
)
def test_a_malformed_profile_is_refused_with_its_key(more, told):
    with pytest.raises(OutputError, match=told) as refusal:
        parse_shop(LEAST + more, "mine", where="mine.toml")
    assert refusal.value.code == "MF421"
    assert "mine.toml" in refusal.value.where


def test_a_source_is_an_address():
    with pytest.raises(OutputError, match="sources"):
        parse_shop(LEAST.replace("[]", '["a leaflet"]'), "mine", where="mine.toml")


@pytest.mark.parametrize("name", ["nobody", "../shops/gesim", "/etc/passwd", "none.toml", ""])
def test_an_unknown_shop_is_refused_with_those_that_are_known(name):
    with pytest.raises(OutputError) as refusal:
        load_shop(name)
    assert refusal.value.code == "MF420"
    assert all(known in refusal.value.cure for known in shop_names())


def test_a_profile_of_ones_own_is_read_by_its_path(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(LEAST, encoding="utf-8")
    assert load_shop(str(path)).title == "A house"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(OutputError, match="MF421"):
        load_shop(str(path))


def test_shops_are_listed(capsys):
    answer = command(capsys, "order", "list")
    assert answer.code == 0
    assert [row.split()[0] for row in answer.stdout.splitlines()[1:]] == list(shop_names())
    document = command(capsys, "order", "list", "--json").document
    assert [shop["name"] for shop in document["shops"]] == list(shop_names())


def test_one_shop_is_shown_with_its_sources(capsys):
    shown = command(capsys, "order", "list", "photoplotstore").stdout
    assert all(source in shown for source in load_shop("photoplotstore").sources)
    document = command(capsys, "order", "list", "photoplotstore", "--json").document
    assert document["limits"]["min_feature_um"] == 6
    assert document["limits"]["max_vertices"] is None
    assert document["tolerance"]["cd_um"][-1] == [None, 2.54]
    json.dumps(document, allow_nan=False)


def test_an_unknown_shop_ends_the_command(capsys):
    answer = command(capsys, "order", "list", "nobody", "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF420")
    assert "generic-chrome" in answer.document["error"]["cure"]
