"""MuJoCo ships no types for its compiled names."""

from typing import Any

def __getattr__(name: str) -> Any: ...
