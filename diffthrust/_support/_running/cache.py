"""JAX's persistent compilation cache, for the command line and for scripts alike."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def enable_compilation_cache() -> Path | None:
    """Keep compiled code between processes, so that only the first run of a kind compiles.

    The folder is the user's cache folder for the package; the environment variable
    ``DIFFTHRUST_CACHE`` names another, and an empty one or ``off`` switches the cache off. A
    folder that cannot be written to switches it off as well: a cache is never worth a failure.
    ``JAX_COMPILATION_CACHE_DIR``, where set, is left to JAX, as is a folder that a script has
    chosen by ``jax.config``.

    Returns:
        The folder, or ``None`` where there is no cache.
    """
    # Equinox raises errors from compiled code by a host callback, and JAX does not cache programs
    # with callbacks. NaN serves as well: the status of every fit checks for it.
    os.environ.setdefault("EQX_ON_ERROR", "nan")
    named = os.environ.get("DIFFTHRUST_CACHE")
    if named is not None and named.strip().lower() in ("", "off"):
        return None
    if named is None and "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return Path(os.environ["JAX_COMPILATION_CACHE_DIR"])
    import jax

    chosen = getattr(jax.config, "jax_compilation_cache_dir", None)
    if named is None and chosen:
        return Path(chosen)
    folder = _writable(named)
    if folder is None:
        return None
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # By default JAX keeps only what took a second to compile; a fit is made of dozens of programs
    # that take less, and together they are most of the time of a first run.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jax.config.update("jax_raise_persistent_cache_errors", False)
    return folder


def _writable(named: str | None) -> Path | None:
    try:
        if named is None:
            import platformdirs

            folder = Path(platformdirs.user_cache_dir("diffthrust", appauthor=False))
        else:
            folder = Path(named).expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder.resolve()
    except (OSError, RuntimeError):
        return None
