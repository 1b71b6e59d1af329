"""Compiled packages, which must fit NumPy and each other."""

from contextlib import contextmanager
from importlib.metadata import version

from parmps.errors import InstallationError


@contextmanager
def fitting(package):
    """Import a compiled package within this context.

    Parameters
    ----------
    package : str
        Its name.

    Raises
    ------
    InstallationError
        With what can be done, where it is missing or was built for another NumPy.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InstallationError(f"{package} cannot be used: {error}") from None
    except (ImportError, ValueError, AttributeError) as error:  # so differ the words of those built for another NumPy
        reason = " ".join(str(error).split())
        raise InstallationError(
            f"{package} does not fit numpy {version('numpy')} ({reason}): install the numpy that it was built for, "
            "with Debian 12 by pip install 'numpy<2' (in a clone of the repository: rm -r .venv, then make setup)"
        ) from None
