"""`takes`: functions that take objects in place of stacks of keywords, and refuse the keywords.

A keyword that is a field of such an object is refused with the call that replaces it. Held by
``tests/base/test_takes.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def takes(**kinds: type[Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a function whose parameters of these names hold dataclasses of these kinds.

    Parameters
    ----------
    **kinds : dataclass by parameter name

    Raises
    ------
    TypeError
        Of the decorated function: a keyword is a field of one of them, or an object is of another kind.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Water:
    ...     current: float = 0.0
    >>> @takes(water=Water)
    ... def fly(*, water=Water()):
    ...     return water.current
    >>> fly(current=0.3)
    Traceback (most recent call last):
    TypeError: fly: current is a field of st.Water; give water=st.Water(current=...)
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        names = set(function.__annotations__)
        homes = {
            field.name: (parameter, kind)
            for parameter, kind in kinds.items()
            for field in fields(kind)
            if field.name not in names
        }

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            for keyword, value in kwargs.items():
                if keyword in homes:
                    parameter, kind = homes[keyword]
                    raise TypeError(
                        f"{function.__name__}: {keyword} is a field of st.{kind.__name__}; give"
                        f" {parameter}=st.{kind.__name__}({keyword}=...)"
                    )
                if keyword in kinds and not isinstance(value, kinds[keyword]):
                    name = kinds[keyword].__name__
                    raise TypeError(
                        f"{function.__name__}: {keyword}: expected an st.{name}, found {value!r}; give"
                        f" {keyword}=st.{name}(...)"
                    )
            return function(*args, **kwargs)

        return checked

    return decorated
