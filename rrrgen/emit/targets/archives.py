"""Reproducible ZIP archives: the bytes depend only on the contents, not on the time of writing."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

from rrrgen.base.files import Contents, as_bytes

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a ZIP file can state


def zip_archive(files: Mapping[str, Contents]) -> bytes:
    """Make a ZIP file of ``files`` (path -> contents), in the order given and without the time of writing."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, contents in files.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, as_bytes(contents))
    return stream.getvalue()
