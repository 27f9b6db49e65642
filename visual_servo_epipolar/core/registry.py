"""Named variants: our own, and those that other installed packages bring by entry points."""

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points, EntryPoint
from typing import Generic, TypeVar

VariantT = TypeVar('VariantT')


class Registry(Mapping[str, VariantT], Generic[VariantT]):
    """
    Variants by name: a table of our own, then the entry points of one group.

    Another package joins with a line in its own setup, ``name = module:object`` under the group.
    Its module is imported when the name is first asked for. Our own names cannot be replaced.

    Parameters
    ----------
    group : str
        Group of entry points, such as ``visual_servo_epipolar.laws``.
    own : mapping
        Our own variants by name.
    check : type, optional
        What a variant from elsewhere must be an instance of; anything callable if not given.

    """

    def __init__(
        self, group: str, own: Mapping[str, VariantT], check: type[VariantT] | None = None
    ) -> None:
        self.group = group
        self._own = dict(own)
        self._check = check
        self._loaded: dict[str, VariantT] = {}

    def __getitem__(self, name: str) -> VariantT:
        """Return the variant ``name``; KeyError if there is none, ValueError if it is broken."""
        if name in self._own:
            return self._own[name]
        if name not in self._loaded:
            self._loaded[name] = self._load(self._entry_points()[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from sorted(set(self._entry_points()) - set(self._own))

    def __len__(self) -> int:
        return len(set(self._own) | set(self._entry_points()))

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._entry_points()

    def _entry_points(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self.group)}

    def _load(self, point: EntryPoint) -> VariantT:
        """Import what an entry point names, and check that it is what the group is for."""
        try:
            variant = point.load()
        except Exception as error:  # foreign code may raise anything while it is imported
            reason = ' '.join(f'{type(error).__name__}: {error}'.split())  # it may have many lines
            raise ValueError(
                f'{point.name} of {self.group} cannot be loaded from {point.value}: {reason}; '
                'mend the entry point of the package that brings it'
            ) from error
        fits = callable(variant) if self._check is None else isinstance(variant, self._check)
        if not fits:
            wanted = 'callable' if self._check is None else f'a {self._check.__name__}'
            raise ValueError(
                f'{point.name} of {self.group} must be {wanted}, got {point.value}, a '
                f'{type(variant).__name__}; mend the entry point of the package that brings it'
            )
        return variant  # type: ignore[no-any-return]
