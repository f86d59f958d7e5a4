"""Links of the documentation to files outside of it: on the site they lead to the repository."""

import re

from mkdocs.config.defaults import MkDocsConfig

OUTSIDE = re.compile(r"\]\((?:\.\./)+([^)]+)\)")


def on_page_markdown(markdown: str, config: MkDocsConfig, **_: object) -> str:
    """The page with such links made absolute."""
    return OUTSIDE.sub(rf"]({config.repo_url}/blob/main/\1)", markdown)
