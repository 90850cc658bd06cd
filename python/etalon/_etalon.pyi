"""The compiled part, whose interface is that of etalon itself."""

from typing import Any

def __getattr__(name: str) -> Any: ...
