"""Trackers as written on a command line: `gmpf`, or `gmpf:particles=40,floor=0.5`."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from vtrack_ros.parameters import Value
from vtrack_ros.trackers import available_peers, Tracker, tracker_class, tracker_names


@dataclass(frozen=True)
class TrackerSpecification:
    """
    A tracker with the parameters that differ from its defaults.

    The label is its name in tables: the text that it was parsed from.
    """

    label: str
    name: str
    parameters: tuple[tuple[str, Value], ...] = ()

    @property
    def tracker_class(self) -> type[Tracker]:
        """Return the class of the tracker."""
        return tracker_class(self.name)

    @property
    def values(self) -> dict[str, Value]:
        """Return all of its parameters' values, the defaults included."""
        return {**self.tracker_class.PARAMETERS.defaults(), **dict(self.parameters)}

    @property
    def deterministic(self) -> bool:
        """Whether every seed gives the same output, so that one run is enough."""
        return bool(getattr(self.tracker_class, 'DETERMINISTIC', False))

    def create(self, seed: int) -> Tracker:
        """Make the tracker."""
        return self.tracker_class(seed, **dict(self.parameters))


def parse_tracker(text: str) -> TrackerSpecification:
    """Parse `name` or `name:parameter=value,...`; ValueError if it isn't valid."""
    label = text.strip()
    name, _, rest = label.partition(':')
    cls = tracker_class(name)
    parameters: dict[str, Value] = {}
    for part in filter(None, rest.split(',')):
        key, equals, value = (piece.strip() for piece in part.partition('='))
        if not equals:
            raise ValueError(f'{label}: expected parameter=value, not {part!r}')
        if key not in cls.PARAMETERS:
            cls.PARAMETERS.checked({key: value}, name)
        parameters[key] = cls.PARAMETERS[key].parsed(value)
    result = TrackerSpecification(label, name, tuple(sorted(parameters.items())))
    # Created once, so that invalid or missing parameters are reported now.
    result.create(0)
    return result


def parse_trackers(text: str) -> list[TrackerSpecification]:
    """
    Return the specifications of a comma-separated list; ValueError if it's wrong or empty.

    `all` means the trackers of this package and of others, `papers` the papers' methods, and
    `peers` OpenCV's own trackers, as far as the installed OpenCV has them. In
    `pf,gmpf:particles=40,floor=0.5,pqkpf` a part with `=` belongs to the tracker before it.
    Duplicates are dropped.
    """
    own = tracker_names(replicas=False)
    groups: dict[str, Callable[[], tuple[str, ...]]] = {
        'all': lambda: own, 'peers': _available_peers,
        'papers': lambda: tuple(
            name for name in tracker_names(installed=False) if name.endswith('_paper'))}
    pieces: list[str] = []
    for part in filter(None, (part.strip() for part in text.split(','))):
        if '=' in part and ':' not in part and pieces:
            pieces[-1] += ',' + part
        else:
            pieces.extend(groups[part]() if part in groups else [part])
    if not pieces:
        raise ValueError('no tracker is given; valid are ' + ', '.join(tracker_names()))
    return specifications(pieces)


def specifications(trackers: Iterable[str | TrackerSpecification]) -> list[TrackerSpecification]:
    """
    Return each tracker as a specification, parsing those that are text; duplicates are dropped.

    ValueError if a text is wrong, or if two trackers have one label: results are kept by label.
    """
    found: dict[str, TrackerSpecification] = {}
    for one in trackers:
        one = parse_tracker(one) if isinstance(one, str) else one
        if found.setdefault(one.label, one) != one:
            raise ValueError(f'two trackers have the label {one.label!r}; '
                             'expected another label for each')
    return list(found.values())


def _available_peers() -> tuple[str, ...]:
    peers = available_peers()
    if not peers:
        raise ValueError(
            'the installed OpenCV has none of the peers (its own trackers); use scripts/peers')
    return peers
