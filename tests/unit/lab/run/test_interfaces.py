"""Interface packages as folders of definitions; that packages can be made is tested with real processes."""

from __future__ import annotations

from pathlib import Path

import pytest

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning")


def test_a_folder_of_definitions_is_a_package(tmp_path: Path) -> None:
    from robot_offload_lab.run import interfaces

    (tmp_path / "moves" / "action").mkdir(parents=True)
    (tmp_path / "moves" / "README.md").write_text("no interface")
    (tmp_path / "moves" / "action" / "Spin.action").write_text(
        "float32 angle  # radians\n---\nbool done\n---\ngeometry_msgs/PoseStamped pose\n"
    )
    package = interfaces.read(tmp_path / "moves")
    assert package.name == "moves"
    assert list(package.interfaces) == ["action/Spin.idl"]
    assert "geometry_msgs::msg::PoseStamped pose;" in package.interfaces["action/Spin.idl"]


def test_what_is_no_definition_is_named_with_its_file(tmp_path: Path) -> None:
    from robot_offload_lab.run import interfaces

    (tmp_path / "srv").mkdir()
    with pytest.raises(interfaces.InterfacesError, match="no interface"):
        interfaces.read(tmp_path)
    (tmp_path / "srv" / "Ask.srv").write_text("what is this\n---\n")
    with pytest.raises(interfaces.InterfacesError, match=r"Ask\.srv"):
        interfaces.read(tmp_path)
