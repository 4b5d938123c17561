"""Outputs of cells: the picture that the gallery shows, and empty texts, which leave."""

from __future__ import annotations

import importlib.util

import pytest

from processes import ROOT

nodes = pytest.importorskip("docutils.nodes")
pytest.importorskip("sphinx")


@pytest.fixture(scope="module")
def site_pages():
    spec = importlib.util.spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "docs")
        spec.loader.exec_module(module)
    return module


def bundle(*outputs):
    """Return the output of a cell as myst-nb stores it, a container a type, and its image."""
    container = nodes.container(nb_element="mime_bundle")
    for kind, content in outputs:
        container += nodes.container("", content, mime_type=kind)
    return next(iter(container.findall(nodes.image)))


def test_pictures_of_bodies_are_told_from_figures(site_pages):
    def text(content):
        return "text/plain", nodes.literal_block(content, content)

    def png():
        return "image/png", nodes.image(uri="x.png")

    page = ("text/html", nodes.raw("", "<iframe></iframe>", format="html"))
    picture = "<picture of heavy_top, 3-G-L at t = 1: 640 × 480>"
    assert site_pages._shows_bodies(bundle(text(picture), png()))
    assert site_pages._shows_bodies(bundle(text("<View of heavy_top>"), page, png()))
    assert not site_pages._shows_bodies(bundle(text("<Figure size 640x480 with 1 Axes>"), png()))
    assert not site_pages._shows_bodies(nodes.image(uri="x.png"))


def test_empty_outputs_leave_the_page(site_pages):
    def output(text):
        block = nodes.container("", nodes.literal_block(text, text), mime_type="text/plain")
        return nodes.container("", block, nb_element="mime_bundle")

    tree = nodes.container("", nodes.container("", output(""), output("3")),
                           nodes.container("", output("")))
    site_pages.remove_empty_outputs(None, tree)
    assert [len(outputs.children) for outputs in tree.children] == [1]
    assert tree.astext() == "3"
