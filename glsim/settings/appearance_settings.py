"""The settings [appearance]: what people wear.

[appearance]
wear = "always"      # also procedural and ict-facekit heads
glasses = 0.5        # half of the subjects
cloth = 0            # none
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from glsim.settings.tables import TomlTable


class AppearanceSettings(TomlTable):
    """What people wear, drawn once per subject. A share of 0 switches a thing off."""

    wear: Literal["auto", "always", "never"] = Field(
        "auto", description="auto: people are dressed, procedural and ict-facekit heads are not"
    )
    # Shares without a source are chosen: every second man has a beard, moustache or stubble.
    hair: float = Field(0.96, ge=0, le=1, description="share of subjects with hair, also shaven")
    beard: float = Field(0.25, ge=0, le=1, description="share with a beard, moustache or stubble")
    brows: float = Field(1.0, ge=0, le=1, description="share with brows in relief")
    # 64 % of adults have glasses (The Vision Council), 54 % of these wear them most of the time.
    glasses: float = Field(0.35, ge=0, le=1, description="share with glasses")
    cloth: float = Field(1.0, ge=0, le=1, description="share with cloth over neck and body")
