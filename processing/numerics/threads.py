"""Work on many parts of a picture at a time."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from numba import get_num_threads

_Item = TypeVar("_Item")
_Found = TypeVar("_Found")


def in_threads(
    work: Callable[[_Item], _Found],
    items: Sequence[_Item],
    told: Callable[[float], object] = lambda _: None,
) -> list[_Found]:
    """What `work` makes of each item, in their order, in as many threads as compiled loops use.

    `told` hears the share that is done. The number of threads changes nothing, as long as each
    item is worked on alone. What `work` raises is raised here.
    """
    found = []
    with ThreadPoolExecutor(get_num_threads(), thread_name_prefix="part") as threads:
        for one in threads.map(work, items):
            found.append(one)
            told(len(found) / len(items))
    return found
