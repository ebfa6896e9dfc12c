"""Results on disk, each whole or absent under its key.

store/<kind>-<key>/           manifest.json, and a product's arrays or a stream's numbered items, and pictures/
                              <name>/<iteration>.jpg where a stage showed how it came along
store/<kind>-<key>.partial/   being written; renamed when whole. A product's is thrown away when found; a stream's items
                              are each whole or absent, and a stage that can resume goes on after them
store/<kind>-<key>.scratch/   the computing stage's own folder; gone when its product is whole
store/cache/<plugin>/         what a plugin keeps under names of its own for other results; may be deleted at any time
"""

import errno
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, cast, overload

import numpy as np
from PIL import Image

from slideframe import compact
from slideframe.arrays import Array, Product
from slideframe.errors import StoreError

# raised whenever the layout below changes, so that older results are not mistaken for new ones
FORMAT = 4
MANIFEST = "manifest.json"
PICTURES = "pictures"
_IMAGE_AXES = ("row", "column", 3)

ProductType = TypeVar("ProductType", bound=Product)


def digest(ingredients: Any) -> str:
    """Return the key of JSON-able ingredients: 128 bits of SHA-256 of their canonical form."""
    text = json.dumps([FORMAT, ingredients], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def digest_file(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def storing(path: Path) -> Iterator[None]:
    """Turn an operating-system error into a StoreError that names the path and the cure."""
    try:
        yield
    except OSError as error:
        cures = {
            errno.ENOSPC: "free some space: the same command then goes on from here",
            errno.EDQUOT: "free some of your quota, or name another folder with --out",
            errno.EEXIST: "a file stands in the way; name another folder with --out",
            errno.ENOTDIR: "a file stands in the way; name another folder with --out",
            errno.EISDIR: "a folder stands in the way of a file; move it, or name another folder with --out",
            errno.EROFS: "name a writable folder with --out",
            errno.EACCES: "name a writable folder with --out",
        }
        raise StoreError(
            f"results can't be written: {error.strerror or error}",
            where=str(error.filename or path),
            cure=cures.get(error.errno or 0, "check the disk, then run the same command again"),
        ) from error


class Stream(Sequence[ProductType], Generic[ProductType]):
    """A finished stream on disk: a sequence of products, each read when asked for."""

    def __init__(self, folder: Path, item: type[ProductType], length: int) -> None:
        """Open a stream of `length` items."""
        self.folder = folder
        self._item = item
        self._length = length

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, index: int) -> ProductType: ...
    @overload
    def __getitem__(self, index: slice) -> "Sequence[ProductType]": ...
    def __getitem__(self, index: int | slice) -> "ProductType | Sequence[ProductType]":
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        return read_product(self.folder / _item_name(index % len(self)), self._item)


@dataclass(frozen=True)
class Entry:
    """The place of one result in the store."""

    folder: Path

    @property
    def is_whole(self) -> bool:
        """Whether the result is there."""
        return (self.folder / MANIFEST).is_file()

    @property
    def manifest(self) -> dict[str, Any]:
        """Figures and origin of the stored result."""
        try:
            return cast(dict[str, Any], _read_json(self.folder / MANIFEST))
        except (OSError, ValueError) as error:
            raise StoreError(
                f"a stored result is damaged: {error}",
                where=str(self.folder),
                cure="delete its folder in the store, then run again",
            ) from error

    @property
    def pictures_of_stage(self) -> Path:
        """Where the computing stage's pictures are, until its product is whole."""
        return self._beside(".scratch") / PICTURES

    @property
    def pictures(self) -> Path:
        """Where the pictures are that the stage showed of how it came along; there may be none."""
        return self.folder / PICTURES

    @property
    def content(self) -> str:
        """The digest of the stored arrays and fields, by which later stages know their input."""
        return str(self.manifest["content"])

    @property
    def scratch(self) -> Path:
        """The computing stage's own folder, made if absent."""
        folder = self._beside(".scratch")
        with storing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        return folder

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other runs from computing this result at the same time; they wait, and find it whole."""
        path = self._beside(".lock")
        with storing(path):
            handle = path.open("w")
        with handle:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        path.unlink(missing_ok=True)

    def write(self, product: Product, finish: Callable[[], dict[str, Any]]) -> None:
        """Store one product; `finish` gives the manifest once all else is written."""
        with self._being_written() as partial:
            content = hashlib.sha256()
            write_product(partial / "product", product)
            _add_folder(content, partial / "product")
            _write_json(partial / MANIFEST, finish() | {"length": None, "content": content.hexdigest()})

    def stored_items(self, product: type[Product]) -> int:
        """Return how many items of a stream that broke off are whole, from the first on."""
        count = 0
        with suppress(StoreError):
            while (self._beside(".partial") / _item_name(count)).is_dir():
                read_product(self._beside(".partial") / _item_name(count), product)
                count += 1
        return count

    def write_stream(
        self,
        items: Iterable[Product],
        finish: Callable[[], dict[str, Any]],
        first: Callable[[], int] = lambda: 0,
        *,
        compactly: bool = False,
    ) -> None:
        """Store items one by one as they come, holding one in memory.

        `first` tells, once an item has come, which it is: those before it are kept as an earlier run stored them.
        `compactly`: in 16 bits a number where an array's declaration says how.
        """
        with self._being_written(keep=True) as partial:
            length, content = 0, hashlib.sha256()
            started = False

            def start() -> int:
                kept = _keep_items(partial, first())
                for index in range(kept):
                    _add_folder(content, partial / _item_name(index))
                return kept

            for item in items:
                if not started:
                    length, started = start(), True
                being_written = partial / f"{_item_name(length)}.partial"
                write_product(being_written, item, compactly=compactly)
                with storing(partial):
                    being_written.rename(partial / _item_name(length))
                _add_folder(content, partial / _item_name(length))
                length += 1
            if not started:  # all were stored
                length = start()
            _write_json(partial / MANIFEST, finish() | {"length": length, "content": content.hexdigest()})

    def read(self, product: type[ProductType]) -> ProductType | Stream[ProductType]:
        """Open the stored product, or the stored stream of such products."""
        length = self.manifest["length"]
        if length is None:
            return read_product(self.folder / "product", product)
        return Stream(self.folder, product, length)

    def _beside(self, suffix: str) -> Path:
        return self.folder.with_name(self.folder.name + suffix)

    @contextmanager
    def _being_written(self, keep: bool = False) -> Iterator[Path]:
        partial = self._beside(".partial")
        with storing(partial):
            if not keep:
                shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True, exist_ok=True)
        yield partial
        with storing(self.folder):
            if self.pictures_of_stage.is_dir():
                # a stream that broke off in its last moment has some there already
                shutil.copytree(self.pictures_of_stage, partial / PICTURES, dirs_exist_ok=True)
            os.sync()  # the arrays too are on the disk before the result counts as whole
            shutil.rmtree(self.folder, ignore_errors=True)
            partial.rename(self.folder)
            _sync_folder(self.folder.parent)
            shutil.rmtree(self._beside(".scratch"), ignore_errors=True)


@dataclass(frozen=True)
class Store:
    """A folder of results, shared by all runs beside it."""

    folder: Path

    def open(self) -> None:
        """Make the folder and prove that it can be written.

        Raises:
            StoreError: it can't.
        """
        with storing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            probe = self.folder / f".probe-{os.getpid()}"
            probe.write_bytes(b"probe")
            probe.unlink()

    def cache(self, plugin: str) -> Path:
        """Return the folder where a plugin keeps what other results of its may use again, made if absent."""
        folder = self.folder / "cache" / plugin
        with storing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        return folder

    def entry(self, kind: str, key: str) -> Entry:
        """Return the place of a result, there or not."""
        return Entry(self.folder / f"{kind}-{key}")


def write_product(folder: Path, product: Product, *, compactly: bool = False) -> None:
    """Write a product's arrays and other fields into a new folder; `compactly`: in 16 bits where declared possible."""
    with storing(folder):
        folder.mkdir(parents=True)
        arrays = product.array_fields()
        plain: dict[str, Any] = product.model_dump(mode="json", exclude=set(arrays) | _nested(type(product)))
        for name, declared in arrays.items():
            _write_array(folder, name, declared, getattr(product, name), compactly)
        for name in _nested(type(product)):
            write_product(folder / name, getattr(product, name))
        _write_json(folder / "fields.json", plain)


def read_product(folder: Path, product: type[ProductType]) -> ProductType:
    """Read a product; large arrays are mapped, not loaded.

    Raises:
        StoreError: something of it is missing or damaged.
    """
    try:
        fields: dict[str, Any] = _read_json(folder / "fields.json")
        for name, declared in product.array_fields().items():
            fields[name] = _read_array(folder, name, declared)
        for name in _nested(product):
            annotation = product.model_fields[name].annotation
            fields[name] = read_product(folder / name, cast(type[Product], annotation))
        return product.model_validate(fields)
    except (OSError, ValueError, EOFError, SyntaxError) as error:  # SyntaxError: a damaged PNG
        raise StoreError(
            f"a stored result is damaged: {error}",
            where=str(folder),
            cure="delete its folder in the store, then run again",
        ) from error


def _nested(product: type[Product]) -> set[str]:
    return {
        name
        for name, field in product.model_fields.items()
        if isinstance(field.annotation, type) and issubclass(field.annotation, Product)
    }


def _write_array(
    folder: Path, name: str, declared: Array, value: np.ndarray[Any, Any], compactly: bool = False
) -> None:
    if declared.axes == _IMAGE_AXES:
        Image.fromarray(value).save(folder / f"{name}.png", compress_level=1)
    elif compactly and declared.compact:
        compact.write(folder, name, value, declared.compact)
    else:
        np.save(folder / f"{name}.npy", value, allow_pickle=False)


def _read_array(folder: Path, name: str, declared: Array) -> np.ndarray[Any, Any]:
    if declared.axes == _IMAGE_AXES:
        with Image.open(folder / f"{name}.png") as image:
            return np.asarray(image)
    decoded = compact.read(folder, name) if declared.compact else None
    if decoded is not None:
        return decoded
    return np.asarray(np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False))


def _add_folder(content: "hashlib._Hash", folder: Path) -> None:
    """Add every file below a folder to a digest, names included, while the system still has them in memory."""
    for path in sorted(item for item in folder.rglob("*") if item.is_file()):
        content.update(str(path.relative_to(folder)).encode())
        content.update(bytes.fromhex(digest_file(path)))


def _keep_items(partial: Path, count: int) -> int:
    """Throw away all of a broken stream but its first `count` items."""
    kept = {_item_name(index) for index in range(count)}
    with storing(partial):
        for path in partial.iterdir():
            if path.name not in kept:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    return count


def _item_name(index: int) -> str:
    return f"{index:06d}"


def _read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _write_json(path: Path, content: Any) -> None:
    with storing(path), path.open("w", encoding="utf-8") as stream:
        json.dump(content, stream, indent=1, allow_nan=False)
        stream.flush()
        os.fsync(stream.fileno())


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
