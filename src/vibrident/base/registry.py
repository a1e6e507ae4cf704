"""Find sensor models, estimators, readers and exports by name, built in or from plug-ins.

Each built-in object has a module of its own in the folder of its kind: the module
``velocity_pickup`` holds ``VELOCITY_PICKUP``, named "velocity-pickup". A plug-in is an object of
the same class behind an entry point of the object's name. Names are known without loading anything;
an object is loaded on first use. A plug-in that cannot be used is reported once and left out.
"""

from __future__ import annotations

import functools
import importlib
import logging
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from vibrident.base.errors import InputError, unknown

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_ROOT = Path(__file__).parents[1]  # of the package
_log = logging.getLogger("vibrident.plugins")

T = TypeVar("T")


@dataclass(frozen=True)
class PlugIn:
    """Entry point of an installed package."""

    group: str  # entry-point group, such as "vibrident.models"
    name: str  # of the object
    package: str  # that brings it, with its version
    problem: str = ""  # why it cannot be used; empty where it can

    @property
    def line(self) -> str:
        """Return one line with the plug-in's name and, if any, its problem."""
        description = f"{self.name} ({self.group}) of {self.package}"
        if self.problem:
            return f"The plug-in {description} cannot be used: {self.problem}"
        return description


class Registry(Generic[T]):
    """Objects of one kind by name: the built-in ones, then those of plug-ins, each sorted by name.

    Args:
        kind: what the objects are, for messages.
        group: entry-point group of plug-ins.
        folders: folders of this package that hold the built-in objects.
        classes: classes of the objects, as "module:Class"; loaded with the first plug-in.
        where: setting by which a user names an object, for messages.
        error: raised for an unknown name.
    """

    def __init__(
        self,
        kind: str,
        group: str,
        folders: tuple[str, ...],
        classes: tuple[str, ...],
        where: str,
        error: type[InputError] = InputError,
    ) -> None:
        self.kind: str = kind
        self.group: str = group
        self.where: str = where
        self._folders = folders
        self._classes = classes
        self._error = error
        self._loaded: dict[str, T] = {}
        self._problems: dict[str, str] = {}
        self._registered: list[str] = []  # names of objects registered by Python

    @property
    def _class_names(self) -> str:
        return " or ".join(path.replace(":", ".") for path in self._classes)

    @functools.cached_property
    def _built_in(self) -> dict[str, str]:
        """Return name → dotted module of the built-in objects."""
        modules = {}
        for folder in self._folders:
            package = f"vibrident.{folder.replace('/', '.')}"
            for file in (_ROOT / folder).glob("[!_]*.py"):
                modules[file.stem.replace("_", "-")] = f"{package}.{file.stem}"
        return dict(sorted(modules.items()))

    @functools.cached_property
    def _added(self) -> dict[str, EntryPoint]:
        """Return name → entry point of plug-ins; of two of one name, that of the first package."""
        points: dict[str, EntryPoint] = {}
        for point in self._points:
            if point.name not in self._built_in:
                points.setdefault(point.name, point)
        return points

    @functools.cached_property
    def _points(self) -> list[EntryPoint]:
        return sorted(
            installed().get(self.group, ()), key=lambda point: (point.name, _package(point))
        )

    def names(self) -> tuple[str, ...]:
        """Return every name; nothing is loaded.

        A plug-in that has turned out not to be usable is left out.
        """
        names = (*self._built_in, *self._added, *self._registered)
        return tuple(name for name in names if name not in self._problems)

    def built_in_names(self, folder: str) -> tuple[str, ...]:
        """Return the names of the built-in objects in a folder; nothing is loaded."""
        begin = f"vibrident.{folder.replace('/', '.')}."
        return tuple(name for name, module in self._built_in.items() if module.startswith(begin))

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def register(self, item: T) -> None:
        """Register an object under its name in this process; it replaces one registered before.

        Raises:
            InputError: the object is of another class, or the name is that of an installed one.
        """
        name = str(getattr(item, "name", ""))
        if not self._is_of_class(item):
            raise self._error(
                f"This is no {self.kind}.",
                expected=self._class_names,
                found=f"one of {type(item).__qualname__}",
                where=self.where,
                remedy=f"give the name of a {self.kind}, or an object of that class",
            )
        if name not in self._built_in and name not in self._added:
            self._loaded[name] = item
            if name not in self._registered:
                self._registered.append(name)
        elif self._object(name) is not item:
            raise self._error(
                f"The name {name!r} is taken.",
                expected=f"a name that no installed {self.kind} has",
                found=repr(name),
                where=self.where,
                remedy="give the object another name",
            )

    def is_registered(self, name: str) -> bool:
        """Return whether the object of this name was registered in this process."""
        return name in self._registered

    def __len__(self) -> int:
        return len(self.all())

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the usable objects; all objects are loaded."""
        return iter(self.all())

    def all(self) -> dict[str, T]:
        """Return name → object of all usable objects."""
        return {name: item for name in self.names() if (item := self._object(name)) is not None}

    def one_by_one(self) -> Iterator[T]:
        """Yield every usable object; a plug-in is loaded when the iteration reaches it."""
        objects = map(self._object, self.names())
        return (item for item in objects if item is not None)

    def __getitem__(self, name: str) -> T:
        """Return the object of this name.

        Raises:
            InputError: the name is unknown, or its package cannot be loaded.
        """
        item = self._object(name)
        if item is not None:
            return item
        if name not in self._problems:
            problem = f"The {self.kind} {name!r} is not known."
            raise unknown(problem, name, self.names(), self.where, kind=self._error)
        raise self._error(
            f"The {self.kind} {name!r} cannot be used.",
            expected=" | ".join(self.names()),
            found=f"a plug-in of {self.package_of(name)}: {self._problems[name]}",
            where=self.where,
            remedy="correct, update or uninstall that package",
        )

    def package_of(self, name: str) -> str:
        """Return the package, with version, of a plug-in; empty for other objects."""
        return _package(self._added[name]) if name in self._added else ""

    def built_in(self) -> tuple[str, ...]:
        """Return the names of this package's own objects; nothing is loaded."""
        return tuple(self._built_in)

    def find(self, name: str) -> T | None:
        """Return the object of this name; None if there is no such object.

        Raises:
            InputError: its package cannot be loaded.
        """
        is_known = name in self._built_in or name in self._added or name in self._registered
        return self[name] if is_known else None

    def _object(self, name: str) -> T | None:
        """Return the object of this name, loaded if necessary; None if there is no usable one."""
        if name in self._loaded or name in self._problems:
            return self._loaded.get(name)
        if name in self._built_in:
            module = self._built_in[name]
            attribute = module.rpartition(".")[2].upper()
            self._loaded[name] = getattr(importlib.import_module(module), attribute)
        elif name in self._added:
            self._load(self._added[name])
        return self._loaded.get(name)

    def _load(self, point: EntryPoint) -> None:
        """Load a plug-in, or report its problem."""
        try:
            item: Any = point.load()
            if not self._is_of_class(item):
                kind = type(item).__qualname__
                problem = f"expected an object of {self._class_names}, found one of {kind}"
            elif item.name != point.name:
                problem = f"its entry point is called {point.name!r}, the object {item.name!r}"
            else:
                self._loaded[point.name] = item
                return
        except (Exception, SystemExit) as error:  # loading a foreign package may raise any error
            problem = f"{type(error).__name__}: {error}"
        self._problems[point.name] = " ".join(problem.split())
        _log.warning(
            PlugIn(self.group, point.name, _package(point), self._problems[point.name]).line
        )

    def _is_of_class(self, item: object) -> bool:
        return isinstance(item, tuple(map(pkgutil.resolve_name, self._classes)))

    def plug_ins(self) -> list[PlugIn]:
        """Return every plug-in of this kind, loaded, with the problem of each unusable one."""
        self.all()
        plug_ins = []
        for point in self._points:
            problem = self._problems.get(point.name, "")
            if self._added.get(point.name) is not point:
                problem = f"the name {point.name!r} is taken"
            plug_ins.append(PlugIn(self.group, point.name, _package(point), problem))
        return plug_ins


@functools.cache
def installed() -> dict[str, list[EntryPoint]]:
    """Return the entry points by group, of the groups of this package."""
    from importlib.metadata import entry_points

    points = entry_points()
    return {
        group: list(points.select(group=group))
        for group in points.groups
        if group.startswith("vibrident.")
    }


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else point.value
