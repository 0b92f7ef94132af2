"""Which networks a study trains, and on what each of them is tested."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from glsim.errors import ConfigError, did_you_mean
from glsim.eval.transfer.study import FaceFamily, SensorFamily, TransferStudy

#: The value of --leave that means every sensor and every source, one after the other.
ALL: Final = "all"

_Family = TypeVar("_Family", SensorFamily, FaceFamily)


@dataclass(frozen=True)
class TrainingSet:
    """The sensors and sources that a network is trained on. name: the folder of its run."""

    sensors: tuple[SensorFamily, ...]
    sources: tuple[FaceFamily, ...]
    name: str


@dataclass(frozen=True)
class Case:
    """Something left out, the cells that test it, and the training set without it.

    title: what is left out, as in tables. training: None if networks are given.
    """

    title: str
    sensors: tuple[SensorFamily, ...]
    sources: tuple[FaceFamily, ...]
    training: TrainingSet | None

    @property
    def cells(self) -> list[tuple[SensorFamily, FaceFamily]]:
        """The cells that are scored."""
        return [(sensor, source) for sensor in self.sensors for source in self.sources]


def find_cases(
    study: TransferStudy,
    leave: Sequence[str] = (),
    train_on: Sequence[str] = (),
    *,
    given: bool = False,
) -> list[Case]:
    """Return the cases of ``--leave sensor:NAME``, ``source:NAME`` or ``all``.

    train_on: names of the only sensors to train on; default: all but the one left out. Without
    ``leave``, each sensor that is not trained on is left out; without both, all are. given: the
    networks are given, nothing is trained, and ``leave`` selects cells. Raises ConfigError.
    """
    by_sensor = {sensor.name: sensor for sensor in study.sensor}
    by_source = {source.name: source for source in study.source}
    chosen = [_known(name, by_sensor, "--train-on", name) for name in dict.fromkeys(train_on)]
    for sensor in chosen:
        if sensor.train_people == 0:
            raise ConfigError(f"--train-on {sensor.name}: this sensor is only tested")
    base = tuple(chosen) or study.trainable
    left_sensors, left_sources = _left_out(leave, by_sensor, by_source, bool(chosen), given)
    if chosen and ALL in (*leave, *([] if leave else [ALL])):
        left_sensors = [sensor for sensor in left_sensors if sensor not in chosen]
    cases = []
    for sensor in left_sensors:
        kept = tuple(other for other in base if other != sensor)
        training = None if given else _training_set(study, kept, study.source)
        if given or training is not None:
            cases.append(Case(f"sensor {sensor.name}", (sensor,), study.source, training))
        elif f"sensor:{sensor.name}" in leave:
            raise ConfigError(f"--leave sensor:{sensor.name}: no other sensor is left to train on")
    for source in left_sources:
        others = tuple(other for other in study.source if other != source)
        tested = tuple(s for s in study.sensor if s not in chosen) or study.sensor
        training = None if given else _training_set(study, base, others)
        if given or training is not None:
            cases.append(Case(f"faces {source.name}", tested, (source,), training))
        elif f"source:{source.name}" in leave:
            raise ConfigError(f"--leave source:{source.name}: no other source is left to train on")
    if not cases:
        raise ConfigError("nothing can be left out: the study needs two sensors or two sources")
    return cases


def _left_out(
    leave: Sequence[str],
    by_sensor: dict[str, SensorFamily],
    by_source: dict[str, FaceFamily],
    one_training: bool,
    given: bool,
) -> tuple[list[SensorFamily], list[FaceFamily]]:
    """Return the sensors and sources that ``--leave`` names, each once and in its order."""
    if not leave:
        sources = [] if one_training or given else list(by_source.values())
        return list(by_sensor.values()), sources
    sensors: dict[str, SensorFamily] = {}
    sources_left: dict[str, FaceFamily] = {}
    for text in leave:
        kind, _, name = text.partition(":")
        if text == ALL:
            sensors |= by_sensor
            sources_left |= {} if given else by_source
        elif kind == "sensor" and name:
            sensors[name] = _known(name, by_sensor, "--leave", text)
        elif kind == "source" and name:
            sources_left[name] = _known(name, by_source, "--leave", text)
        else:
            raise ConfigError(f"--leave {text}: write sensor:NAME, source:NAME or {ALL}")
    return list(sensors.values()), list(sources_left.values())


def _known(name: str, families: dict[str, _Family], option: str, text: str) -> _Family:
    if name not in families:
        raise ConfigError(f"{option} {text}: not in this study ({did_you_mean(name, families)})")
    return families[name]


def _training_set(
    study: TransferStudy, sensors: tuple[SensorFamily, ...], sources: tuple[FaceFamily, ...]
) -> TrainingSet | None:
    """Return the training set with a name that says what it holds or lacks; None if it is empty."""
    if not sensors or not sources:
        return None
    parts = (
        _label([s.name for s in sensors], [s.name for s in study.trainable], "sensors"),
        _label([s.name for s in sources], [s.name for s in study.source], "faces"),
    )
    return TrainingSet(sensors, sources, "_".join(parts))


def _label(names: list[str], all_names: list[str], kind: str) -> str:
    missing = [name for name in all_names if name not in names]
    if not missing:
        return f"all-{kind}"
    if len(missing) < len(names):
        return f"without-{'-'.join(missing)}"
    return "-".join(names)
