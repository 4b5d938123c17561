"""``gs.cite``: what a stepper rests on is named, and every entry can be read by BibTeX."""

from __future__ import annotations

import re

import pytest

import gyrospark as gs
import systems
from calls import RUN, TOP
from gyrospark.certificates.citations import WORKS
from gyrospark.generator.schemes.named_schemes import SCHEMES
from processes import ROOT


def keys(stepper):
    return [work.key for work in gs.cite(stepper)]


def test_each_scheme_names_its_own():
    """The stepper of the first names the sources; for the others their records do."""
    assert keys(systems.stepper("heavy_top")) == ["gyrospark", "xu2020", "betsch2009", "jay2007",
                                                  "hairer2008", "antonana2017"]
    for scheme, sources in (("EMS", ["gonzalez1996", "gonzalez1999", "mclachlan1999"]),
                            ("LIIIA-B", ["jay1996"]), ("IMS", ["hairer2006"]),
                            ("Radau-L", ["hairer1996"])):
        assert [*SCHEMES[scheme].sources] == sources


def test_what_has_no_body_and_no_constraint_names_less():
    pendulum = systems.stepper("pendulum")
    assert not {"xu2020", "betsch2009"} & set(keys(pendulum))


def test_a_run_names_what_its_stepper_does():
    step = systems.stepper("heavy_top")
    run = step.integrate(TOP.q0, TOP.p0, steps=3, **RUN)
    assert gs.cite(run).reasons == gs.cite(step).reasons
    now = step.start(TOP.q0, TOP.p0, **RUN)
    assert gs.cite(now).reasons == gs.cite(step).reasons
    with pytest.raises(gs.InputError, match="takes a stepper"):
        gs.cite("G-L")


def test_entries_are_whole():
    for work in WORKS.values():
        entry = work.bibtex()
        assert entry.count("{") == entry.count("}")
        assert re.match(rf"@(article|book|software)\{{{work.key},\n", entry)
        if work.kind == "article":
            assert {"journal", "volume", "doi"} <= work.where.keys()
            assert re.fullmatch(r"10\.\d{4,5}/\S+", work.where["doi"])
        assert work.title in str(work)
    assert all(key in WORKS for scheme in SCHEMES.values() for key in scheme.sources)


def test_the_program_is_that_of_the_citation_file():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    program = WORKS["gyrospark"]
    assert f"version: {program.where['version']}\n" in text
    assert f"title: {program.title.partition(':')[0]}\n" in text
    assert "name: the gyrospark authors" in text
    title = " ".join(re.search(r"title: >-\n((?: {6}.*\n)+)", text)[1].split())
    assert title == WORKS["xu2020"].title


def test_bibtex_and_text_have_every_work():
    step = systems.stepper("heavy_top")
    citations = gs.cite(step)
    assert re.findall(r"^@\w+\{(\w+),", citations.bibtex(), flags=re.MULTILINE) == keys(step)
    assert len(str(citations).splitlines()) == 2 * len(citations)
    assert "444–473" in str(citations)
