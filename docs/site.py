"""For mkdocs: links that lead out of docs/ become the names of the files."""

import re
from typing import Any

_UPWARDS = re.compile(r"\[([^\]]*)\]\(((?:\.\./)+)([^)#]*\.md)[^)]*\)")


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """The page with links to files of the repository outside of docs/ as plain words."""
    depth = page.file.src_uri.count("/")

    def plain(link: re.Match[str]) -> str:
        return f"{link[1]} (`{link[3]}`)" if link[2].count("../") > depth else link[0]

    return _UPWARDS.sub(plain, markdown)
