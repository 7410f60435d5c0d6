"""The TLS files of a Dask cluster, from a small TOML file."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from calibtool.errors import InputError
from calibtool.robot.toml_text import parse_toml, read_model


class ClusterSecurity(BaseModel):
    """Paths of PEM files: the authority that signed the certificates of scheduler and workers, and
    certificate and key of this client. Connections without TLS are refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    tls_ca_file: Path
    tls_client_cert: Path
    tls_client_key: Path

    @property
    def options(self) -> dict[str, object]:
        """Arguments of `distributed.Security`."""
        files = {name: str(path) for name, path in self}
        return {"require_encryption": True, **files}


def parse_security(text: str, place: str, folder: Path) -> ClusterSecurity:
    """The files that a TOML text names, relative to a folder.

    InputError, with `place`, for other keys and for files that are not there.
    """
    named = read_model(ClusterSecurity, parse_toml(text, place), place)
    found = {name: folder / path for name, path in named}
    for name, path in found.items():
        if not path.is_file():
            raise InputError(f"{place}: {name}: {path}: no such file")
    return ClusterSecurity(**found)
