# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Links, anchors, commands, options, parameters, make targets and versions in pages exist.

Web addresses are not requested, as tests need no network. For `ros2 topic`, `service` and `bag`,
which the wheels do not have, only names are checked.
"""

import importlib
import importlib.util
import re
import runpy
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml
from markdown_it import MarkdownIt
from markdown_it.token import Token

from docs.pages import NODES
from rover_parameters.parameters import parameters
from terrain_estimator.dashboard.values import TOPICS as SHOWN
from terrain_estimator.messaging.slip_source import JOINTS, VELOCITY
from terrain_estimator.nodes.onboard import divided
from terrain_estimator.nodes.terrain_map import TOPICS as MAPPED
from terrain_estimator.nodes.watch import TOPICS as WATCHED
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES, RECORDED_TOPICS
from terramechanics.presets import load_soil
from tests.launch_stand_in import declared
from tools.pictures.nodes import PICTURE, nodes_picture
from tools.site.links import lead, source_of
from tools.site.lists import indented

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "bags/README.md",
    ROOT / "bags/foreign/README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
POLICY = ROOT / "docs/examples/sros2/policy.xml"
PACKAGES = ("msg_defs", "rover_parameters", "terramechanics", "rover_sim_node", "terrain_estimator")
FOREIGN = ("robot_state_publisher",)
"""Packages of an installed ROS that a page runs."""
ENDS = (  # of a command; a line that goes on begins with an option in brackets
    r"(?:[^|;&#\n]|\n +\[)*"
)
every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@cache
def tokens(page: Path) -> tuple[Token, ...]:
    """Return the tokens of blocks and of their content."""
    blocks = MarkdownIt("commonmark").enable("table").parse(page.read_text(encoding="utf-8"))
    return tuple(token for block in blocks for token in (block, *(block.children or ())))


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings, as GitHub makes them."""
    found = [
        token.content
        for before, token in zip(tokens(page), tokens(page)[1:], strict=False)
        if before.type == "heading_open"
    ]
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in found}


def code(page: Path) -> list[str]:
    return [
        token.content
        for token in tokens(page)
        if token.type in {"code_inline", "code_block", "fence"}
    ]


@cache
def executables() -> dict[tuple[str, str], str]:
    """Module by package and executable."""
    texts = {
        package: (ROOT / package / "setup.py").read_text(encoding="utf-8")
        for package in PACKAGES[1:]
    }
    entries = r'"(\w+) = ([\w.]+):main"'
    return {
        (package, name): module
        for package, text in texts.items()
        for name, module in re.findall(entries, text)
    }


@cache
def targets() -> dict[str, str]:
    """Recipe by target of make."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return dict(re.findall(r"^([a-z-]+):[^=].*\n((?:\t.*\n)*)", text, re.MULTILINE))


def commands(page: Path) -> Iterator[tuple[str, str, str]]:
    """Package, executable and arguments of every `ros2 run`, those that make hands on included."""
    for text in code(page):
        found = re.findall(rf"ros2 run (\w+) (\w+)({ENDS})", text)
        yield from (each for each in found if each[0] not in FOREIGN)
        for target, arguments in re.findall(r'make ([a-z-]+) ARGS="([^"]*)"', text):
            for package, name in re.findall(r"ros2 run (\w+) (\w+) \$\(ARGS\)", targets()[target]):
                yield package, name, arguments


def modules(page: Path) -> Iterator[tuple[str, str]]:
    """Yield module and arguments of every `python -m` of ours, also those called by make."""
    for text in code(page):
        yield from re.findall(
            rf"python3? -m ((?:tests|benchmarks|docs|studies)[\w.]*)({ENDS})", text
        )
        for target, arguments in re.findall(r'make ([a-z-]+) ARGS="([^"]*)"', text):
            for module in re.findall(r"python -m ([\w.]+).* \$\(ARGS\)", targets()[target]):
                if module != "pytest":
                    yield module, arguments


@cache
def known_options(module: str, *arguments: str) -> frozenset[str]:
    """Return the options that --help of a command-line program lists."""
    shown: list[str] = []
    package = importlib.util.find_spec(module)
    assert package, f"python -m {module}"
    main = importlib.import_module(
        f"{module}.__main__" if package.submodule_search_locations else module
    ).main
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", [module, *arguments, "--help"])
        patch.setattr(
            "argparse.ArgumentParser.print_help", lambda parser: shown.append(parser.format_help())
        )
        with pytest.raises(SystemExit):
            main()
    return frozenset(re.findall(r"--[a-z-]+|-p\b", shown[0]))


@every_page
def test_links_lead_to_files_and_headings(page: Path) -> None:
    links = [
        str(token.attrs.get("href") or token.attrs.get("src"))
        for token in tokens(page)
        if token.type in {"link_open", "image"}
    ]
    for link in links:
        if link.startswith(("http://", "https://")):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{link}: no such file"
        assert not anchor or anchor in anchors(target), (
            f"{link}: {target.name} has {sorted(anchors(target))}"
        )


@every_page
def test_targets_of_make_exist(page: Path) -> None:
    for text in code(page):
        for target in re.findall(r"\bmake ([a-z-]+)", text):
            assert target in targets(), f"make {target}"


@every_page
def test_executables_exist_and_know_their_options(page: Path) -> None:
    for package, name, arguments in commands(page):
        if not re.match(r"[A-Z]+$", name):
            assert (package, name) in executables(), f"ros2 run {package} {name}"
        own = arguments.partition("--ros-args")[0]
        if options := set(re.findall(r"(?<![\w-])--[a-z-]+", own)) - {"--help"}:
            module = executables()[package, name]
            form = re.findall(r"^ (replay|discover)\b", own)
            form += ["--wheel-table", "FILE"] if "--wheel-table" in options else []
            known = {"--dump-config"} if name in NODES else known_options(module, *form)
            assert options <= known, f"{name}: {options - known}"


@every_page
def test_modules_exist_and_know_their_options(page: Path) -> None:
    for module, arguments in modules(page):
        options = set(re.findall(r"(?<![\w-])--[a-z-]+", arguments)) - {"--help"}
        known = known_options(module)
        assert options <= known, f"{module}: {options - known}"


@every_page
def test_topics_services_and_pinned_packages_are_those_of_the_project(page: Path) -> None:
    text = "\n".join(code(page))
    published = {*INPUT_TYPES, *OUTPUT_TYPES, *RECORDED_TOPICS, *SHOWN}
    assert set(re.findall(r"ros2 topic (?:hz|info|echo) (?:-\S+ )*([\w/]+)", text)) <= published
    services = re.findall(r"ros2 service call /(\w+)/(\w+) ([\w/]+)", text)
    kinds = {"change_state": "lifecycle_msgs/srv/ChangeState"}
    assert all(
        node in NODES and kind == kinds.get(name, "std_srvs/srv/Trigger")
        for node, name, kind in services
    ), services
    lists = "\n".join(
        path.read_text(encoding="utf-8") for path in sorted((ROOT / "requirements").glob("*.txt"))
    )
    for pinned in re.findall(r"(?<=[ \n])[\w.-]+==[\w.]+", text):
        assert re.search(rf"^{re.escape(pinned)}\b", lists, re.MULTILINE), (
            f"{pinned} is not what requirements/ pins"
        )


@every_page
def test_parameters_are_those_of_the_node(page: Path) -> None:
    every = [(name, arguments) for _, name, arguments in commands(page)]
    together = [divided(arguments.split()) for name, arguments in every if name == "onboard"]
    every = [each for each in every if each[0] != "onboard"]
    every += [(name, " ".join(words)) for own in together for name, words in own.items()]
    for name, arguments in every:
        given = set(re.findall(r"-p ([a-z_.]+):=", arguments))
        node = {"replay": "estimator", "add_slip": "slip_source"}.get(name, name)
        if given:
            known = {each.name for each in parameters(NODES[node])} | {"use_sim_time"}
            assert given <= known, f"{name}: {given - known}"


def test_the_checks_find_commands_to_check() -> None:
    found = [each for page in PAGES for each in commands(page)]
    assert len(found) > 40
    assert any("-p" in arguments for *_, arguments in found)
    assert any("\n" in arguments for *_, arguments in found), "a command over two lines"
    assert known_options("terrain_estimator.cli.replay") >= {"--compare", "--out", "-p"}
    of_ours = {module for page in PAGES for module, _ in modules(page)}
    assert of_ours >= {
        "tests.hidden.matters",
        "tests.hidden.judge",
        "tests.terrain_estimator.discovery.discover",
        "tests.fuzz",
    }


def test_the_soil_that_the_page_shows_is_a_soil_file(tmp_path: Path) -> None:
    (text,) = (
        token.content
        for token in tokens(ROOT / "docs/bring_your_own_soil.md")
        if token.type == "fence"
    )
    path = tmp_path / "my_sand.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_soil(path).name == path.stem


def test_the_program_without_ros_that_the_page_shows_runs(tmp_path: Path) -> None:
    (text,) = (
        token.content
        for token in tokens(ROOT / "docs/estimator.md")
        if token.type == "code_block" and "import" in token.content
    )
    path = tmp_path / "program.py"
    path.write_text(text, encoding="utf-8")
    assert runpy.run_path(str(path))["update"].decision.outcome is Outcome.ACCEPTED


def first(pattern: str, path: Path) -> str:
    """Return what the first match of the group holds in a file."""
    found = re.search(pattern, path.read_text(encoding="utf-8"), re.MULTILINE)
    assert found, f"{path}: no {pattern}"
    return found[1]


def test_versions_are_one() -> None:
    found = {first(r"<version>(.+)</version>", ROOT / name / "package.xml") for name in PACKAGES}
    found |= {first(r'version="(.+)"', ROOT / name / "setup.py") for name in PACKAGES[1:]}
    found |= {yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"]}
    found |= {first(r"^## (\d+\.\d+\.\d+)", ROOT / "CHANGELOG.md")}
    assert len(found) == 1, found


def test_the_policy_has_an_enclave_of_every_node_and_the_page_makes_its_keys() -> None:
    nodes = {
        name
        for (_, name), module in executables().items()
        if (".nodes." in module and name != "onboard") or module == "rover_sim_node.simulator"
    }
    enclaves = ET.parse(POLICY).findall(".//enclave")
    profiles = {
        enclave.get("path"): [profile.get("node") for profile in enclave.iterfind(".//profile")]
        for enclave in enclaves
    }
    assert profiles == {f"/terrain/{name}": [name] for name in nodes | {"operator"}}
    made = re.search(
        r"for node in (.+); do", (ROOT / "docs/security.md").read_text(encoding="utf-8")
    )
    assert made
    assert set(made[1].split()) == nodes | {"operator"}
    assert nodes == set(NODES)


@pytest.mark.parametrize(
    ("node", "publish", "subscribe"),
    [
        ("estimator", {*OUTPUT_TYPES, "estimator_health"}, set(INPUT_TYPES)),
        ("recorder", set(), set(RECORDED_TOPICS)),
        ("planner", {"traction_advice"}, {*INPUT_TYPES, "terrain_estimate"}),
        ("dashboard", set(), set(SHOWN)),
        ("watch", set(), {*WATCHED, "ground_truth/terrain"}),
        ("terrain_map", {"terrain_map", "terrain_grid"}, set(MAPPED)),
        ("slip_source", {"wheel_slip", "/diagnostics"}, {JOINTS, VELOCITY}),
    ],
)
def test_the_policy_allows_a_node_its_topics_and_no_more(
    node: str, publish: set[str], subscribe: set[str]
) -> None:
    found = [
        ET.parse(POLICY).iterfind(f".//profile[@node='{node}']/topics[@{verb}='ALLOW']/topic")
        for verb in ("publish", "subscribe")
    ]
    assert [{topic.text for topic in topics} for topics in found] == [publish, subscribe]


@every_page
def test_launch_files_exist_and_know_their_arguments(page: Path) -> None:
    for package, name, arguments in re.findall(
        r"ros2 launch (\w+) (\w+\.launch\.py)([^`\n]*)", "\n".join(code(page))
    ):
        known = set(declared(ROOT / package / "launch" / name))
        assert set(re.findall(r"(\w+):=", arguments)) <= known, f"{name}: {arguments}"


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    def pages(entry: object) -> Iterator[str]:
        if isinstance(entry, str):
            yield entry
        elif isinstance(entry, dict):
            for inner in entry.values():
                yield from pages(inner)
        elif isinstance(entry, list):
            for inner in entry:
                yield from pages(inner)

    shown = list(pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    assert len(set(shown)) == len(shown)
    assert {source_of(page) for page in shown} == {str(page.relative_to(ROOT)) for page in PAGES}


def test_links_lead_from_the_repository_to_the_site() -> None:
    copied: list[str] = []
    text = (
        "[a](../README.md#two-commands) ![b](images/cost.png)"
        " [c](../terrain_estimator/layouts/foxglove.json) [d](../tests)"
    )
    assert lead(text, "api.md", copied.append) == (
        "[a](index.md#two-commands) ![b](images/cost.png)"
        " [c](files/terrain_estimator/layouts/foxglove.json) d"
    )
    assert copied == ["terrain_estimator/layouts/foxglove.json"]
    assert lead("[a](docs/method.md) [b](gone.md)", "index.md", copied.append) == (
        "[a](method.md) [b](gone.md)"
    )


def test_lists_are_indented_for_the_site() -> None:
    text = "Two:\n- one\n  line\n\n      code\n- two\n\nEnd.\n"
    assert indented(text) == ("Two:\n\n- one\n    line\n\n        code\n\n- two\n\nEnd.\n")


def test_the_readme_has_at_most_900_words() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    assert len(shown.split()) <= 900


def test_the_picture_of_nodes_shows_what_the_policy_allows() -> None:
    assert PICTURE.read_text(encoding="utf-8") == nodes_picture(), "run make pages"
    assert set(NODES) <= set(re.findall(r'class="title".*>(\w+)<', nodes_picture()))
