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
    """A sensor or source that is left out, as ``title`` says, and the cells that test it.

    ``training`` is the training set without it; None if networks are given.
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
    """Find what to leave out and what to test.

    Args:
        study: its sensors and sources.
        leave: ``sensor:NAME``, ``source:NAME`` or ``all``; default: each sensor outside
            ``train_on``, or all without it.
        train_on: the only sensors to train on; default: all but the one left out.
        given: nothing is trained, and ``leave`` selects cells.

    Raises:
        ConfigError: a name is unknown, or nothing is left to train on.

    """
    by_sensor = {sensor.name: sensor for sensor in study.sensor}
    by_source = {source.name: source for source in study.source}
    chosen = tuple(_trainable(name, by_sensor) for name in dict.fromkeys(train_on))
    base = chosen or study.trainable
    unseen = tuple(sensor for sensor in study.sensor if sensor not in chosen)
    if given and not leave:
        return [Case("-", study.sensor, study.source, None)]
    left = {text: _parsed(text, by_sensor, by_source) for text in leave if text != ALL}
    if ALL in leave or not leave:
        left |= {f"sensor:{sensor.name}": sensor for sensor in unseen}
        # With --train-on, faces are left out on request only.
        if not given and (leave or not chosen):
            left |= {f"source:{source.name}": source for source in study.source}
    cases = []
    for text, family in left.items():
        sensors, sources = base, study.source
        tested_sensors, tested_sources = unseen or study.sensor, study.source
        if isinstance(family, SensorFamily):
            tested_sensors = (family,)
            sensors = tuple(sensor for sensor in base if sensor != family)
        else:
            tested_sources = (family,)
            sources = tuple(source for source in study.source if source != family)
        training = None if given else _training_set(study, sensors, sources)
        if given or training is not None:
            title = text.replace(":", " ")
            cases.append(Case(title, tested_sensors, tested_sources, training))
        elif text in leave:
            raise ConfigError(f"--leave {text}: nothing else is left to train on")
    if not cases:
        raise ConfigError("nothing can be left out: the study needs two sensors or two sources")
    return cases


def _parsed(
    text: str, by_sensor: dict[str, SensorFamily], by_source: dict[str, FaceFamily]
) -> SensorFamily | FaceFamily:
    """Return the family that ``--leave`` names. Raises ConfigError."""
    kind, _, name = text.partition(":")
    if kind == "sensor" and name:
        return _known(name, by_sensor, f"--leave {text}")
    if kind == "source" and name:
        return _known(name, by_source, f"--leave {text}")
    raise ConfigError(f"--leave {text}: write sensor:NAME, source:NAME or {ALL}")


def _trainable(name: str, families: dict[str, SensorFamily]) -> SensorFamily:
    """Return the sensor that ``--train-on`` names. Raises ConfigError."""
    sensor = _known(name, families, f"--train-on {name}")
    if sensor.train_people == 0:
        raise ConfigError(f"--train-on {name}: this sensor is only tested")
    return sensor


def _known(name: str, families: dict[str, _Family], option: str) -> _Family:
    if name not in families:
        raise ConfigError(f"{option}: not in this study ({did_you_mean(name, families)})")
    return families[name]


def _training_set(
    study: TransferStudy, sensors: tuple[SensorFamily, ...], sources: tuple[FaceFamily, ...]
) -> TrainingSet | None:
    """Return the training set, named by what it holds or lacks; None if it is empty."""
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
