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

import dynid

ROOT = Path(__file__).parents[2]
TOOLS = ("mkdocs-material>=9.5", "mkdocstrings[python]>=0.26", "nbconvert>=7", "ipykernel>=6")
NAV = {
    "Tutorials": ["tutorial-real-data.md", "tutorial-simulated.md", "tutorial.md"],
    "How to": [
        "recordings.md",
        "robot-files.md",
        "running.md",
        "safety.md",
        "models.md",
        "fleet.md",
    ],
    "Explanation": [
        "equations.md",
        "excitation.md",
        "warnings.md",
        "verdicts.md",
        "architecture.md",
    ],
    "Reference": ["reference/cli.md", "reference/api.md", "json.md", "controller.md", "studio.md"],
}


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
    parts = ["# Examples\n"]
    for path in sorted((ROOT / "examples").glob("*.py")):
        parts.append(f"## {path.stem.replace('_', ' ')}\n\n```python\n{path.read_text()}```\n")
    return "\n".join(parts)


def commands() -> str:
    """`--help` of every command."""
    run = [sys.executable, "-m", "dynid"]
    whole = subprocess.run([*run, "--help"], capture_output=True, text=True, check=True).stdout
    listed = re.findall(r"^  ([a-z]+)  +\S", whole.partition("Commands:")[2], re.MULTILINE)
    parts = ["# Commands\n", f"```\n{whole}```\n"]
    for name in listed:
        done = subprocess.run([*run, name, "--help"], capture_output=True, text=True, check=True)
        parts.append(f"## dynid {name}\n\n```\n{done.stdout}```\n")
    return "\n".join(parts)


def notebooks(python: Path, source: Path) -> list[str]:
    """Execute the notebooks; their pages."""
    target = source / "notebooks"
    run = [str(python), "-m", "nbconvert", "--log-level", "WARN", "--execute"]
    run += ["--to", "markdown", "--output-dir"]
    for path in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")):
        subprocess.run([*run, str(target), str(path)], check=True)
    return [f"notebooks/{path.name}" for path in sorted(target.glob("*.md"))]


def configuration(source: Path, target: Path, executed: list[str]) -> str:
    """mkdocs.yml."""
    nav = {**NAV, "Examples": ["examples.md", *executed]}
    known = {page for group in nav.values() for page in group} | {"index.md"}
    rest = sorted(path.name for path in source.glob("*.md") if path.name not in known)
    nav["Explanation"] = [*nav["Explanation"], *rest]
    lines = [
        f"  - {title}:\n" + "".join(f"      - {page}\n" for page in nav[title]) for title in nav
    ]
    return (
        "site_name: dynid\n"
        f"docs_dir: {source}\nsite_dir: {target}\n"
        "use_directory_urls: false\n"
        "theme:\n  name: material\n  font: false\n"
        "  features: [navigation.tabs, content.code.copy]\n"
        "  palette:\n"
        "    - {media: '(prefers-color-scheme: light)', scheme: default}\n"
        "    - {media: '(prefers-color-scheme: dark)', scheme: slate}\n"
        "extra_css: [site.css]\n"
        "plugins:\n  - search\n  - mkdocstrings:\n      handlers:\n        python:\n"
        f"          paths: [{ROOT / 'src'}]\n"
        "          options: {docstring_style: google, show_source: false, heading_level: 2,\n"
        "            show_root_heading: true, show_root_full_path: false}\n"
        "markdown_extensions: [tables, fenced_code, admonition, pymdownx.highlight, "
        "pymdownx.superfences]\n"
        "validation: {omitted_files: warn, anchors: warn, unrecognized_links: warn}\n"
        "nav:\n  - dynid: index.md\n" + "".join(lines)
    )


def main() -> None:
    """Build the site."""
    build = ROOT / "build"
    target = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else build / "site"
    source = build / "site-pages"
    shutil.rmtree(source, ignore_errors=True)
    python = environment(build / "site-env")
    pages(source)
    executed = notebooks(python, source)
    config = build / "mkdocs.yml"
    config.write_text(configuration(source, target, executed), encoding="utf-8")
    words = ["-m", "mkdocs", "build", "--quiet", "--strict", "--config-file", str(config)]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    subprocess.run([str(python), *words], check=True, env=quiet)
    pages_made = len(list(target.rglob("*.html")))
    print(f"{os.path.relpath(target / 'index.html', ROOT)}: {pages_made} pages")


if __name__ == "__main__":
    main()
