# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Extend mkdocs: pages from outside docs/, links, formulas, the API reference."""

import html
import re

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from tools.site.links import PAGES, ROOT, address_of, lead
from tools.site.lists import indented
from tools.site.reference import reference

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\s*\\[(\[](?P<tex>.*?)\\[)\]]\s*</(?P=tag)>', re.DOTALL
)

_BARE = re.compile(r"\\(mathbf|mathrm|bar|dot) (\w)")  # the converter wants braces
_FUNCTION = "(?:tan|sin|cos|log|det)"  # which the converter sets without the usual spaces
_AFTER = re.compile(rf"(?<=[\w}}])\s*\\({_FUNCTION}\b)")
_OPERATOR = re.compile(rf"(\\{_FUNCTION}\b)(?=\s*\\?\w)(?!\s*\\left)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Use GitHub's anchors, and append the API pages to the navigation."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = _slug
    entries = [
        {package: [{_title(path): path} for path in pages]}
        for package, pages in reference().items()
    ]
    for section in config.nav or []:
        for entry in next(iter(section.values())):
            if isinstance(entry, dict) and "API" in entry:
                entry["API"] = entries
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and files that are not in docs/."""
    for source, address in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, address, content=text))
    for pages in reference().values():
        for address, text in pages.items():
            files.append(File.generated(config, address, content=text))
    linked: set[str] = set()
    for file in list(files.documentation_pages()):
        lead(file.content_string, file.src_uri, linked.add)
    for path in sorted(linked):
        copy = File.generated(config, address_of(path), abs_src_path=str(ROOT / path))
        files.append(copy)
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Lead the page's links to the site, and indent its lists."""
    if page.file.src_uri.startswith("api/"):
        return markdown
    return indented(lead(markdown, page.file.src_uri, lambda _: None))


def on_page_content(content: str, **_: object) -> str:
    """Write formulas as MathML, which browsers draw themselves."""
    return _FORMULA.sub(_mathml, content)


def _mathml(match: re.Match[str]) -> str:
    tex = _BARE.sub(r"\\\1{\2}", html.unescape(match["tex"]).strip())
    tex = _OPERATOR.sub(r"\1\\,", _AFTER.sub(r"\\,\\\1", tex))
    return str(convert(tex, display="block" if match["tag"] == "div" else "inline"))


def _slug(text: str, separator: str) -> str:
    return re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", separator)


def _title(path: str) -> str:
    name = path.removeprefix("api/").removesuffix(".md")
    return name.partition(".")[2] or name
