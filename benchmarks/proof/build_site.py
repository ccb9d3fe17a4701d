"""The site: the pages of docs/, a reference made from docstrings and `--help`, executed notebooks.

    python benchmarks/proof/build_site.py [TARGET]        default: build/site

MkDocs and its theme live in an environment of their own (build/site-env), which sees the packages
of this one. `--strict`: a broken link is an error. The pages open from the file system.
"""

import os
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import yaml

import dynid

sys.path.insert(0, str(Path(__file__).parents[1]))
from shared.measuring import ROOT, child, run

TOOLS = ("mkdocs-material>=9.5", "mkdocstrings[python]>=0.26", "nbconvert>=7", "ipykernel>=6")
NAV = {
    "Tutorials": "tutorial-real-data tutorial-simulated tutorial",
    "How to": "recordings robot-files running safety models fleet",
    "Explanation": "equations excitation warnings verdicts architecture",
    "Reference": "reference/cli reference/api json controller studio",
}
"""Pages in their order; those that it does not name are explanations."""
CSS = """.md-typeset td code { word-break: normal; white-space: nowrap; }
.md-typeset td:not(:first-child) code { white-space: normal; }
"""


def environment(folder: Path) -> Path:
    """The interpreter that has the tools; it also sees this one's packages."""
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, *TOOLS], check=True)
        here = [path for path in sys.path if path.endswith("site-packages")]
        (site,) = folder.glob("lib/python*/site-packages")
        (site / "dynid-here.pth").write_text("\n".join([*here, str(ROOT / "src")]) + "\n")
    return python


def pages(source: Path) -> None:
    """Write all pages as Markdown."""
    shutil.copytree(ROOT / "docs", source)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (source / "index.md").write_text(text.replace("](docs/", "]("), encoding="utf-8")
    (source / "examples.md").write_text(examples(), encoding="utf-8")
    (source / "reference").mkdir()
    (source / "reference" / "cli.md").write_text(commands(), encoding="utf-8")
    public = [getattr(dynid, name) for name in dynid.__all__ if not name.startswith("_")]
    body = "\n\n".join(f"::: {thing.__module__}.{thing.__name__}" for thing in public)
    (source / "reference" / "api.md").write_text(f"# Python\n\n{body}\n", encoding="utf-8")
    titles = {
        path.name: path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        for path in source.glob("*.md")
    }
    for path in source.rglob("*.md"):
        # What stands outside docs is shown by its name.
        text = path.read_text(encoding="utf-8")
        outside = re.compile(r"\[([^\]]+)\]\((?:\.\./)?(?:examples|urtwin|benchmarks)/?[^)]*\)")
        text = outside.sub(r"\1", text)
        # A page is called by its title, not by its file.
        text = re.sub(
            r"\[(?:docs/)?([\w-]+\.md)\]\(\1",
            lambda found: f"[{titles.get(found[1], found[1])}]({found[1]}",
            text,
        )
        path.write_text(text, encoding="utf-8")
    (source / "site.css").write_text(CSS, encoding="utf-8")


def examples() -> str:
    """The scripts of examples/, with what they say of themselves."""
    paths = sorted((ROOT / "examples").glob("*.py"))
    parts = [f"## {p.stem.replace('_', ' ')}\n\n```python\n{p.read_text()}```\n" for p in paths]
    return "\n".join(["# Examples\n", *parts])


def commands() -> str:
    """`--help` of every command."""
    whole = child(["-m", "dynid", "--help"])
    listed = re.findall(r"^  ([a-z]+)  +\S", whole.partition("Commands:")[2], re.MULTILINE)
    each = [(name, child(["-m", "dynid", name, "--help"])) for name in listed]
    parts = [f"## dynid {name}\n\n```\n{text}```\n" for name, text in each]
    return "\n".join([f"# Commands\n\n```\n{whole}```\n", *parts])


def notebooks(python: Path, source: Path) -> list[str]:
    """Execute the notebooks; their pages."""
    target = source / "notebooks"
    run = [str(python), "-m", "nbconvert", "--log-level", "WARN", "--execute"]
    run += ["--to", "markdown", "--output-dir"]
    for path in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")):
        subprocess.run([*run, str(target), str(path)], check=True)
    return [f"notebooks/{path.name}" for path in sorted(target.glob("*.md"))]


def configuration(source: Path, target: Path, executed: list[str]) -> dict[str, Any]:
    """mkdocs.yml."""
    nav = {title: [f"{name}.md" for name in names.split()] for title, names in NAV.items()}
    nav["Examples"] = ["examples.md", *executed]
    known = {page for group in nav.values() for page in group} | {"index.md"}
    nav["Explanation"] += sorted(p.name for p in source.glob("*.md") if p.name not in known)
    shown = {"docstring_style": "google", "show_source": False, "heading_level": 2}
    shown |= {"show_root_heading": True, "show_root_full_path": False}
    python = {"paths": [str(ROOT / "src")], "options": shown}
    palettes = [
        {"media": f"(prefers-color-scheme: {name})", "scheme": scheme}
        for name, scheme in (("light", "default"), ("dark", "slate"))
    ]
    return {
        "site_name": "dynid",
        "docs_dir": str(source),
        "site_dir": str(target),
        "use_directory_urls": False,
        "theme": {
            "name": "material",
            "font": False,
            "features": ["navigation.tabs", "content.code.copy"],
            "palette": palettes,
        },
        "extra_css": ["site.css"],
        "plugins": ["search", {"mkdocstrings": {"handlers": {"python": python}}}],
        "markdown_extensions": [
            "tables", "fenced_code", "admonition", "pymdownx.highlight", "pymdownx.superfences",
        ],
        "validation": dict.fromkeys(("omitted_files", "anchors", "unrecognized_links"), "warn"),
        "nav": [{"dynid": "index.md"}, *({title: names} for title, names in nav.items())],
    }  # fmt: skip


def main(target: Path = ROOT / "build" / "site", /) -> None:
    """Build the site."""
    build, target = ROOT / "build", target.resolve()
    source = build / "site-pages"
    shutil.rmtree(source, ignore_errors=True)
    python = environment(build / "site-env")
    pages(source)
    executed = notebooks(python, source)
    config = build / "mkdocs.yml"
    config.write_text(yaml.safe_dump(configuration(source, target, executed)), encoding="utf-8")
    words = ["-m", "mkdocs", "build", "--quiet", "--strict", "--config-file", str(config)]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    subprocess.run([str(python), *words], check=True, env=quiet)
    pages_made = len(list(target.rglob("*.html")))
    print(f"{os.path.relpath(target / 'index.html', ROOT)}: {pages_made} pages")


if __name__ == "__main__":
    run(main)
