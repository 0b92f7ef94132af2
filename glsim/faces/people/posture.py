"""Postures and movements of people, as rotations of the bones.

Directions and targets are in the axes of the body at rest (+x left, +y up, +z front), mm from the
person's joints, so that they suit a child and a heavy man alike. People in front of a camera sit
comfortably, so angles are much smaller than healthy people's limits (neck: 60 degrees of rotation,
45 of flexion to a side, American Academy of Orthopaedic Surgeons, 1965).

Movements: breathing, sway, and nods of the head against the torso; the pipeline adds the rigid
motion of the head for all generated faces. Quiet standing sways by 0.5 to 1 degree below 1 Hz (D.
A. Winter, Gait and Posture 3, 1995); people at rest breathe 12 to 20 times a minute and lift the
chest by 4 to 12 mm (Sherwood, Human Physiology).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Final

import numpy as np

from glsim.core.array_types import Array
from glsim.core.pose import rotation
from glsim.core.products import norm, product
from glsim.core.seeds import rng_for

#: Ranges of angles, shares and frequencies, by name.
_TABLE: Final = tomllib.loads(files(__package__).joinpath("posture.toml").read_text("utf-8"))
#: Postures of the arms.
ARMS: Final = tuple(_TABLE["standing"])


@dataclass(frozen=True)
class BodyShape:
    """The joints and trunk dimensions of a body at rest that decide its posture, mm.

    ``half_width``: of the trunk between chest and hips; ``front``: its z at the chest; ``joints``:
    bone -> (3,); ``chin``: (3,), its foremost point.
    """

    joints: Mapping[str, Array]
    half_width: float
    front: float
    chin: Array


@dataclass(frozen=True)
class Posture:
    """A posture: kind of arms (of ARMS), and bone -> (3, 3) rotation relative to its parent."""

    turns: Mapping[str, Array]
    sitting: bool
    arms: tuple[str, str]


def sample_posture(seed: int, subject: str, sequence: str, body: BodyShape) -> Posture:
    """Draw the posture of a sequence; a pure function of its arguments."""
    rng = rng_for(seed, "posture", subject, sequence)
    sitting = bool(rng.random() < _TABLE["sitting_share"])
    left = str(rng.choice(ARMS, p=[*_TABLE["sitting" if sitting else "standing"].values()]))
    right = left
    if left in ("chin", "raised"):
        right = "front" if sitting else "sides"
    elif left != "crossed" and rng.random() < 0.4 and not sitting:
        right = "front" if left == "sides" else "sides"
    arms = (left, right) if rng.random() < 0.5 else (right, left)
    turns = _neck_and_spine(rng, gentle="chin" in arms)
    leg = _sitting_leg if sitting else _standing_leg
    for side, sign in (("L", 1.0), ("R", -1.0)):
        turns |= leg(rng, body, side, sign)
    for side, sign, kind in (("L", 1.0, arms[0]), ("R", -1.0, arms[1])):
        turns |= _arm(rng, body, side, sign, kind, sitting)
    return Posture(turns, sitting, arms)


def _neck_and_spine(rng: np.random.Generator, gentle: bool) -> dict[str, Array]:
    sampled = [float(np.clip(rng.normal(0.0, sd), -most, most)) for sd, most in _TABLE["look_deg"]]
    if gentle:  # keep the chin above the hand
        sampled = [0.3 * value for value in sampled]
    shares = _TABLE["neck"].items()
    turns = {bone: rotation(*(share * angle for angle in sampled)) for bone, share in shares}
    lean = float(np.clip(rng.normal(*_TABLE["lean_deg"]), -4.0, 14.0))
    sideways = float(np.clip(rng.normal(0.0, _TABLE["sideways_deg"]), -6.0, 6.0))
    twist = float(np.clip(rng.normal(0.0, _TABLE["twist_deg"]), -10.0, 10.0))
    share = 1.0 / len(_TABLE["spine"])
    for bone in _TABLE["spine"]:
        turns[bone] = rotation(share * twist, -share * lean, share * sideways)
    return turns


def _standing_leg(
    rng: np.random.Generator, body: BodyShape, side: str, sign: float
) -> dict[str, Array]:
    """Draw the rotations of one leg of a standing person, with the feet flat on the floor."""
    hip, ankle = (body.joints[f"{bone}.{side}"] for bone in ("upperleg01", "foot"))
    apart, step = float(rng.uniform(0.0, 0.07)), float(rng.uniform(-0.03, 0.03))
    thigh = _between(ankle - hip, np.array([sign * apart, -1.0, (ankle - hip)[2] / 900.0 + step]))
    return {f"upperleg01.{side}": thigh, f"foot.{side}": thigh.T}


def _sitting_leg(
    rng: np.random.Generator, body: BodyShape, side: str, sign: float
) -> dict[str, Array]:
    hip, knee, ankle = (body.joints[f"{b}.{side}"] for b in ("upperleg01", "lowerleg01", "foot"))
    apart, back = float(rng.uniform(0.05, 0.3)), float(rng.uniform(-0.25, 0.2))
    thigh = _between(knee - hip, np.array([sign * apart, float(rng.uniform(-0.12, 0.05)), 1.0]))
    shin = _between(ankle - knee, product(thigh.T, np.array([0.0, -1.0, back])))
    foot = product(thigh, shin).T  # flat on the floor
    return {f"upperleg01.{side}": thigh, f"lowerleg01.{side}": shin, f"foot.{side}": foot}


def _arm(
    rng: np.random.Generator, body: BodyShape, side: str, sign: float, kind: str, sitting: bool
) -> dict[str, Array]:
    """Draw the rotations of one arm: the wrist reaches a target, the elbow points outwards."""
    joints = body.joints
    shoulder, elbow, wrist = (joints[f"{b}.{side}"] for b in ("upperarm01", "lowerarm01", "wrist"))
    upper, lower = norm(elbow - shoulder), norm(wrist - elbow)
    outside = max(sign * shoulder[0], body.half_width) + _TABLE["gap_mm"]
    a, b = float(rng.uniform(-1, 1)), float(rng.uniform(-1, 1))
    curl = float(rng.uniform(*_TABLE["curl_deg"]))
    table = kind == "front" and sitting  # hands on a table, or on the thighs
    height = joints[f"upperleg01.{side}"][1] + (110.0 if a < 0 else 0.35 * upper + 90.0)
    hand = norm(joints[f"finger3-1.{side}"] - wrist)
    before = body.front
    targets: dict[str, tuple[float, ...]] = {  # of the wrist, mm
        "sides": (
            sign * (outside + 35.0 + 10.0 * a),
            shoulder[1] - 0.965 * (upper + lower),
            shoulder[2] + 25.0 + 30.0 * b,
        ),
        "table": (sign * (130.0 + 50.0 * b), height, before + (0.55 if a < 0 else 0.75) * lower),
        "front": (  # hands held before the belly, one before the other
            sign * (55.0 + 15.0 * a),
            shoulder[1] - upper - 30.0 * b,
            before + 75.0 + 22.0 * sign,
        ),
        "crossed": (
            -sign * 0.2 * body.half_width,
            shoulder[1] - 0.72 * upper + 20.0 * sign,
            before + 62.0 + 24.0 * sign,
        ),
        "raised": (  # a gesture beside the chest
            sign * (outside + 40.0 + 50.0 * a),
            shoulder[1] - 0.55 * upper + 60.0 * b,
            before + 0.6 * lower,
        ),
        # A fist under the chin, beside the midline.
        "chin": tuple(body.chin + np.array([sign * 30.0, -hand - 33.0, 24.0])),
    }
    goal = "table" if table else kind
    target, elbow_to = np.array(targets[goal]), np.array(_TABLE["elbows"][goal]) * (sign, 1.0, 1.0)
    curl = _TABLE["fist_deg"] if kind == "chin" else curl
    bent = _elbow(shoulder, target, upper, lower, elbow_to)
    reached = bent + lower * _unit(target - bent)
    first = _between(elbow - shoulder, bent - shoulder)
    second = _between(wrist - elbow, product(first.T, reached - bent))
    turns = {f"upperarm01.{side}": first, f"lowerarm01.{side}": second}
    return turns | fingers(joints, side, curl)


def fingers(joints: Mapping[str, Array], side: str, curl_deg: float) -> dict[str, Array]:
    """Return the rotations that curl the fingers towards the palm, the thumb less."""
    axis = _unit(joints[f"finger5-1.{side}"] - joints[f"finger2-1.{side}"])
    along = joints[f"finger3-2.{side}"] - joints[f"finger3-1.{side}"]
    if np.cross(axis, along)[1] > 0:  # the finger would bend upwards
        axis = -axis
    parts = [f"finger{finger}-{part}.{side}" for finger in (2, 3, 4, 5) for part in (1, 2, 3)]
    thumb = {f"finger1-2.{side}": _about(axis, 0.4 * curl_deg)}
    return dict.fromkeys(parts, _about(axis, curl_deg)) | thumb


def _elbow(shoulder: Array, target: Array, upper: float, lower: float, towards: Array) -> Array:
    """Return the position of the elbow if the wrist is at ``target``, or as near as possible."""
    along = target - shoulder
    least, most = 1.05 * abs(upper - lower) + 0.3 * upper, 0.995 * (upper + lower)
    reach = float(np.clip(norm(along), least, most))
    along = _unit(along)
    near = (upper**2 - lower**2 + reach**2) / (2 * reach)
    side = _unit(towards - (towards * along).sum() * along)
    return np.asarray(shoulder + near * along + np.sqrt(max(upper**2 - near**2, 0.0)) * side)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / norm(vector))


def _about(axis: Array, degrees: float) -> Array:
    """Return the rotation (3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.asarray(np.eye(3) + sin * cross + product((1 - cos) * cross, cross))


def _between(start: Array, end: Array) -> Array:
    """Return the smallest rotation (3, 3) from one direction to another."""
    start, end = _unit(start), _unit(end)
    axis = np.cross(start, end)
    sine = norm(axis)
    if sine < 1e-9:
        return np.eye(3)
    return _about(axis / sine, float(np.degrees(np.arctan2(sine, (start * end).sum()))))


def movement(
    seed: int, subject: str, sequence: str, framing: str, time_s: float
) -> Mapping[str, Array]:
    """Return the rotations of breathing, swaying and head movement at a time: bone -> (3, 3)."""
    rng = rng_for(seed, "movement", subject, sequence)
    breath = np.sin(2 * np.pi * (rng.uniform(*_TABLE["breaths_hz"]) * time_s + rng.uniform()))
    chest, shoulder = rng.uniform(*_TABLE["chest_deg"]), rng.uniform(*_TABLE["shoulder_deg"])
    deg, hz = _TABLE["sway_deg"], _TABLE["sway_hz"]
    sway = [rng.uniform(*deg) * _wave(rng, hz, time_s) for _ in range(3)]
    most = _TABLE["head_deg"][framing]
    head = [scale * most * _wave(rng, _TABLE["head_hz"], time_s) for scale in (1.0, 0.6, 0.4)]
    if rng.random() < _TABLE["nod_share"] and framing != "face":
        start, length = rng.uniform(0.1, 1.0), rng.uniform(0.4, 0.8)
        inside = np.clip((time_s - start) / length, 0.0, 1.0)
        head[1] -= rng.uniform(3.0, 8.0) * np.sin(np.pi * inside) ** 2
    # The neck turns back by the chest's angle, so that the head does not nod with each breath.
    turns = {
        "spine05": rotation(*(0.5 * angle for angle in sway)),
        "spine02": rotation(0.0, chest * breath, 0.0),
        "neck01": rotation(0.0, -chest * breath, 0.0),
        "clavicle.L": rotation(0.0, 0.0, -shoulder * breath),
        "clavicle.R": rotation(0.0, 0.0, shoulder * breath),
        "neck03": rotation(*head),
    }
    for side in "LR":
        swing = rng.uniform(*_TABLE["arm_deg"])
        pitch, roll = (swing * _wave(rng, (0.1, 0.5), time_s) for _ in range(2))
        turns[f"upperarm01.{side}"] = rotation(0.0, pitch, roll)
    return turns


def _wave(rng: np.random.Generator, band_hz: Sequence[float], time_s: float) -> float:
    """Evaluate a smooth random curve in [-1, 1], in which slower waves have larger amplitudes."""
    low_hz, high_hz = band_hz
    hz = np.sort(rng.uniform(low_hz, high_hz, _TABLE["waves"]))
    phase = rng.uniform(0.0, 1.0, _TABLE["waves"])
    size = 1.0 / np.arange(1, _TABLE["waves"] + 1)
    return float((size * np.sin(2 * np.pi * (hz * time_s + phase))).sum() / size.sum())
