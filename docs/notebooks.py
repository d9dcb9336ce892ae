"""Notebooks as pages of the manual: executed when it is built, answers in its own style, no network."""

from __future__ import annotations

import os
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

_ANSWERS = """\
{% extends "markdown/index.md.j2" %}
{% block input %}
```python
{{ cell.source }}
```
{% endblock input %}
{% block stream %}
```text
{{ output.text | trim }}
```
{% endblock stream %}
{% block data_text scoped %}
```text
{{ output.data["text/plain"] | trim }}
```
{% endblock data_text %}
{% block data_html scoped %}
<div class="output">
{{ output.data["text/html"] | one_line }}
</div>
{% endblock data_html %}
{% block data_svg scoped %}
![{{ cell.source.splitlines()[-1] | forceescape }}]({{ output.metadata.filenames["image/svg+xml"] }})
{% endblock data_svg %}
{% block data_png scoped %}
![{{ cell.source.splitlines()[-1] | forceescape }}]({{ output.metadata.filenames["image/png"] }})
{% endblock data_png %}
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and its pictures."""
    from mkdocs.structure.files import File

    for path in sorted((Path(config.docs_dir) / "notebooks").glob("*.ipynb")):
        text, pictures = _page(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
        for name, data in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=data))
    return files


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse a manual that would ask a network for anything but a page that a reader follows a link to."""
    from mkdocs.exceptions import PluginError

    for path in Path(config.site_dir).rglob("*.html"):
        text = path.read_text("utf-8")
        parts = re.findall(r"<(?:script|link|img|iframe|source)\b[^>]*?(?:src|href)=\"?((?:https?:)?//[^\"\s>]+)", text)
        if parts:
            raise PluginError(f"{path} needs a network: {', '.join(parts)}")
    for path in Path(config.site_dir).rglob("*.css"):
        if re.search(r"url\([\"']?(?:https?:)?//|@import", path.read_text("utf-8")):
            raise PluginError(f"{path} needs a network")


def _page(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook that was run in an empty folder, as Markdown, and its pictures by name.

    Raises:
        nbclient.exceptions.CellExecutionError: for a cell that fails, so that no manual shows what does not run.
    """
    import nbformat
    from jinja2 import DictLoader
    from nbconvert import MarkdownExporter
    from nbconvert.preprocessors import ExecutePreprocessor

    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    book = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        ExecutePreprocessor(timeout=900, kernel_name="python3").preprocess(book, {"metadata": {"path": folder}})
    exporter = MarkdownExporter(extra_loaders=[DictLoader({"answers.md.j2": _ANSWERS})], template_file="answers.md.j2")
    exporter.register_filter("one_line", _one_line)
    text, more = exporter.from_notebook_node(book, {"output_files_dir": f"{path.stem}_files"})
    source = f"[Open the notebook]({path.name}){{ download }} and run it yourself.\n"
    head, _, rest = text.strip().partition("\n")
    return f"{head}\n\n{source}\n{rest}\n", more["outputs"]


def _one_line(html: str) -> str:
    """HTML without line breaks, which Markdown would read; those of preformatted text stay as references."""
    kept = re.sub(r"<pre.*?</pre>", lambda text: text[0].replace("\n", "&#10;"), html, flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", " ", kept)
