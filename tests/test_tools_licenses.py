"""tools/licenses.py: every pinned package has a license that is known and goes with ours."""

import email.message

import pytest
from packaging.requirements import Requirement


@pytest.fixture(scope="module")
def tool(tools):
    import licenses

    return licenses


def test_every_pinned_package_has_a_license_that_goes_with_ours_and_is_listed(tool, root):
    assert (root / tool.TABLE).read_text(encoding="utf-8") == tool.table(root), (
        "run `make licenses`"
    )


def test_nothing_is_explained_that_is_not_pinned(tool):
    names = {requirement.name for requirement in tool.pinned()}
    assert set(tool.READ_BY_US) | set(tool.ELSEWHERE) <= names


@pytest.mark.parametrize(
    ("expression", "answer"),
    [
        ("MIT", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("GPL-3.0-only", False),
        ("MIT AND GPL-3.0-or-later", False),
        ("Artistic-1.0 OR GPL-2.0-or-later", True),
        ("GPL-2.0-only OR AGPL-3.0-only", False),
        ("LicenseRef-Proprietary", False),
        ("", False),
    ],
)
def test_expressions_are_judged(tool, expression, answer):
    assert tool.agrees(expression) is answer


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ([("License-Expression", "MIT"), ("License", "GPL-3.0-only")], "MIT"),
        ([("License", "MPL-2.0 AND MIT")], "MPL-2.0 AND MIT"),
        ([("Classifier", "License :: OSI Approved :: ISC License (ISCL)")], "ISC"),
        (
            [("License", "see file"), ("Classifier", "License :: OSI Approved :: BSD License")],
            "BSD",
        ),
    ],
)
def test_metadata_of_all_ages_are_read(tool, fields, expected):
    assert tool.stated("some-package", metadata(fields)) == expected


def test_unknown_licenses_are_errors(tool, monkeypatch, capsys):
    gpl = "License :: OSI Approved :: GNU General Public License v3 (GPLv3)"
    for fields, words in (
        ([], "no license in its metadata"),
        ([("License", "UNKNOWN")], "no license in its metadata"),
        ([("Classifier", gpl)], "not known to go with ours"),
    ):
        monkeypatch.setattr(tool.importlib.metadata, "metadata", lambda _, f=fields: metadata(f))
        with pytest.raises(tool.UnknownLicense, match=f"some-package: .*{words}"):
            tool.licenses([Requirement("some-package==1")])
    assert tool.main(["--check"]) == 1
    assert "error: " in capsys.readouterr().out


def test_packages_that_are_not_here_are_errors(tool):
    with pytest.raises(tool.UnknownLicense, match="not installed; run `make env`"):
        tool.licenses([Requirement("package-of-nowhere==1")])
    with pytest.raises(tool.UnknownLicense, match="add it to ELSEWHERE"):
        tool.licenses([Requirement("package-of-nowhere==1 ; sys_platform == 'plan9'")])


def metadata(fields):
    message = email.message.Message()
    for name, value in fields:
        message[name] = value
    return message
