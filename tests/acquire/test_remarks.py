"""Every remark of a decomposition says all three: what, what it means, what to do."""

from __future__ import annotations

import importlib
import pkgutil

import processing
from acquire.methods.components import cautions_of
from processing.remarks import Remark


def test_every_remark_is_made_of_whole_sentences() -> None:
    remarks = [
        value
        for module in pkgutil.walk_packages(processing.__path__, "processing.")
        for value in vars(importlib.import_module(module.name)).values()
        if isinstance(value, Remark)
    ]
    assert len(remarks) >= 4
    # A caution that lacks an end or a part cannot be made.
    assert len(cautions_of(tuple(remarks))) == len(remarks)
    for remark in remarks:
        assert all(part[0].isupper() for part in (remark.what, remark.meaning, remark.remedy))
