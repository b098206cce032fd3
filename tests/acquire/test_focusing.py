"""Figures for turning the lenses, on simulated benches with and without blur."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from acquire.bench_file import SimSection
from acquire.calibrating.finding import Setting
from acquire.calibrating.focusing import Shot, look
from acquire.cli.main import app
from acquire.plan import CameraPlan, ProjectorPlan
from acquire.rig import Bench, Resumption
from acquire.rig.simulated import simulated_bench
from drivers.errors import ProjectorError
from drivers.protocols import Devices

SIM = SimSection(scene="board", camera_px=(40, 40), projector_px=(120, 160))


def shots(bench: Bench, count: int | None = 1, exposure_s: float = 0.1) -> Iterator[Shot]:
    setting = Setting(CameraPlan(exposure_s=exposure_s), ProjectorPlan(), bench.resolution)
    return look(bench, setting, count, threading.Event())


def bench(**changes: object) -> Bench:
    return simulated_bench(SIM.model_copy(update=changes))


def test_the_chart_grows_with_the_projectors_focus_and_the_camera_stays() -> None:
    # The bench blurs what is projected, not what the camera sees.
    found = [next(shots(bench(blur_px=blur_px))) for blur_px in (2.0, 1.0, 0.0)]
    charts = [shot.chart or 0 for shot in found]
    assert charts == sorted(charts)
    assert charts[2] > 2 * charts[0]
    assert found[0].camera == pytest.approx(found[2].camera, rel=0.02)
    assert found[2].clipped == 0
    assert found[2].lit > 0.95


def test_saturated_light_has_no_figure() -> None:
    found = next(shots(bench(), exposure_s=10))
    assert (found.chart, found.camera) == (None, None)
    assert found.clipped > 0.9


def test_the_projector_is_blanked_however_looking_ends() -> None:
    opened: list[Devices] = []
    whole = bench()

    def connect(resumption: Resumption, closing: ExitStack) -> Devices:
        opened.append(whole._connect(resumption, closing))
        return opened[-1]

    looking = shots(replace(whole, _connect=connect), None)
    assert [next(looking).number for _ in range(2)] == [1, 2]
    opened[0].projector.check()
    looking.close()  # type: ignore[attr-defined]  # what a second Ctrl-C does to a generator
    with pytest.raises(ProjectorError, match="closed"):
        opened[0].projector.check()


def test_lines_of_json() -> None:
    result = CliRunner().invoke(app, ["calibrate", "focus", "--shots", "2", "--json"])
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert [line["number"] for line in lines] == [1, 2]
    assert lines[0].keys() == {"number", "chart", "camera", "clipped", "lit"}
    refused = CliRunner().invoke(app, ["calibrate", "leak"])
    assert refused.exit_code != 0
