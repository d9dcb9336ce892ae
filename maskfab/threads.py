"""One thread for each call of a numerical library.

Our products are small: a second thread saves little on a quiet machine, and on a busy one its waiting costs more than
the product. Cores are kept busy by working on several dies at once instead.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

Given = ParamSpec("Given")
Result = TypeVar("Result")


def one_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """For functions that other programs call: limits the libraries that are loaded, and restores them afterwards."""

    @wraps(function)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):
            return function(*args, **kwargs)

    return limited
