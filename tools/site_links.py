"""A hook of the site's build: links to what is no part of the site go to where the repository is hosted.

Pages link to files and folders of the repository as they lie, so that the links work in a checkout, too.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

LINK = re.compile(r"(\]\()([^)\s#:]+)")
FOLDER = "docs"


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """The text of a page with such links made absolute; mkdocs calls this for every page."""
    here = posixpath.join(FOLDER, posixpath.dirname(page.file.src_uri))
    root = Path(config.config_file_path).parent

    def hosted(found: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(here, found[2]))
        if (root / target).is_dir():
            return f"{found[1]}{config.repo_url.rstrip('/')}/tree/main/{target}"
        if (root / target).is_file() and target.split("/")[0] != FOLDER:
            return f"{found[1]}{config.repo_url.rstrip('/')}/blob/main/{target}"
        return found[0]

    return LINK.sub(hosted, markdown)
