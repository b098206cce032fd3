"""What every projector does (see `drivers.protocols.Projector`)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from drivers.errors import ProjectorError
from tests.contracts.benches import PROJECTORS, ProjectorCase


@pytest.fixture(params=PROJECTORS)
def case(request: pytest.FixtureRequest) -> Iterator[ProjectorCase]:
    case = PROJECTORS[request.param]()
    yield case
    case.projector.close()


def test_resolution_is_a_height_and_a_width(case: ProjectorCase) -> None:
    height, width = case.projector.resolution
    assert height > 0
    assert width > 0


@pytest.mark.parametrize("colours", [pytest.param((), id="grey"), pytest.param((3,), id="colour")])
def test_rasters_of_its_size_are_shown(case: ProjectorCase, colours: tuple[int, ...]) -> None:
    before_s = case.clock.now()
    case.projector.show(np.zeros((*case.projector.resolution, *colours), np.uint8))
    assert case.clock.now() - before_s >= case.settle_s - 1e-6


def test_a_raster_of_another_shape_is_refused_and_both_shapes_are_named(
    case: ProjectorCase,
) -> None:
    height, width = case.projector.resolution
    for shape in [(height + 1, width), (height, width, 4), (width * height,), (height, width - 1)]:
        with pytest.raises(ValueError, match="fit") as caught:
            case.projector.show(np.zeros(shape, np.uint8))
        assert str(shape) in str(caught.value)
        assert str((height, width)) in str(caught.value)


def test_a_raster_of_another_type_is_refused(case: ProjectorCase) -> None:
    with pytest.raises(ValueError, match="float64"):
        case.projector.show(np.zeros(case.projector.resolution))  # type: ignore[arg-type]


def test_the_caller_may_reuse_a_raster_that_was_shown(case: ProjectorCase) -> None:
    raster = np.zeros(case.projector.resolution, np.uint8)
    raster.flags.writeable = False
    case.projector.show(raster)
    case.projector.show(raster)


def test_what_is_shown_stands_until_it_is_closed(case: ProjectorCase) -> None:
    case.projector.show(np.zeros(case.projector.resolution, np.uint8))
    case.projector.check()
    case.projector.close()
    with pytest.raises(ProjectorError):
        case.projector.check()


def test_it_can_be_closed_twice_and_shows_nothing_after(case: ProjectorCase) -> None:
    case.projector.close()
    case.projector.close()
    with pytest.raises(ProjectorError):
        case.projector.show(np.zeros(case.projector.resolution, np.uint8))
