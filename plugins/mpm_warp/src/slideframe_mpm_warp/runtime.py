"""Warp's global state: the kernels of each precision, compiled once a process, and silence while they load."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType


@cache
def kernels_in(precision: str, device: str, shared_nodes: bool, keeps_excess: bool) -> ModuleType:
    """Return the package of kernels in `precision`, compiled for `device`.

    `shared_nodes`: for many threads a node; `keeps_excess`: for transfers by which particles keep their own velocity.
    """
    with _quiet():
        import warp as wp

        # on a machine without a card Warp's library says so to stderr, whatever its log level
        with _silent_stderr() if device == "cpu" else nullcontext():
            wp.init()  # type: ignore[no-untyped-call]
        kernels = _package_in(precision, shared_nodes, keeps_excess)
        wp.load_module(kernels, device=device, recursive=True)
    return kernels


@cache
def _package_in(precision: str, shared_nodes: bool, keeps_excess: bool) -> ModuleType:
    """Execute the package `kernels` under a name of its own, since Warp keeps the functions of one name together."""
    import warp as wp

    name = f"slideframe_mpm_warp.kernels_{precision}" + "_shared" * shared_nodes + "_excess" * keeps_excess
    folder = Path(__file__).with_name("kernels")
    specification = spec_from_file_location(name, folder / "__init__.py", submodule_search_locations=[str(folder)])
    assert specification is not None
    assert specification.loader is not None
    package = module_from_spec(specification)
    chosen = {"precision": getattr(wp, precision), "shared_nodes": shared_nodes, "keeps_excess": keeps_excess}
    package.__dict__.update(chosen)
    sys.modules[name] = package
    specification.loader.exec_module(package)
    # Warp writes each operation as a statement of its own, across which Clang would not fuse a product and a sum
    flags = f"{wp.config.cpu_compiler_flags or '-march=native'} -ffp-contract=fast"
    for module in [module for path, module in sys.modules.items() if path.startswith(f"{name}.")]:
        wp.set_module_options({"cpu_compiler_flags": flags}, module=module)
    return package


@contextmanager
def _quiet() -> Iterator[None]:
    """Let Warp report errors only, and give its settings back."""
    import warp as wp

    level = wp.config.log_level
    wp.config.log_level = wp.LOG_ERROR
    try:
        yield
    finally:
        wp.config.log_level = level


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Send what native code writes to the process's stderr nowhere."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
