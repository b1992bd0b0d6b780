"""The documents: links lead somewhere, every field of a file format is described, commands name options that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drape.data import animation_hdf5, schema

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
GROUPS = "scene|fabric|contact|model|loss|ablation|scale|data|measure|trainer|logger"
OPTION = re.compile(rf"\b({GROUPS})=([a-z][a-z0-9_]*)(?=[\s`]|$)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert target.startswith("http") or (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_name_options_that_exist(page):
    for line in page.read_text(encoding="utf-8").splitlines():
        for group, option in OPTION.findall(line) if "python src/" in line or "drape " in line else ():
            assert (ROOT / "conf" / group / f"{option}.yaml").is_file(), f"{group}={option}: {line}"


def test_the_readme_links_every_page():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(f"docs/{page.name}" in text for page in PAGES[1:])
    assert len(text.splitlines()) <= 120


def test_every_field_is_described():
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    of_groups = [field for group in schema.FIELDS.values() for field in group]
    fields = *of_groups, *schema.SHEET_FIELDS, *animation_hdf5.FIELDS, *animation_hdf5.BODY
    of_groups = [name for group in schema.GROUP_ATTRIBUTES.values() for name in group]
    attributes = *schema.ATTRIBUTES, *schema.SHEET_ATTRIBUTES, *schema.MATERIAL_ATTRIBUTES, *of_groups
    names = [*(field.name for field in fields), *attributes, *animation_hdf5.ATTRIBUTES]
    assert not [name for name in names if f"`{name}`" not in text]
