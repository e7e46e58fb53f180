"""Builds of the package bring the stored data along, as ``lissome/_data``.

The folder ``data`` stands beside ``src``, where readers look for it, so that no setting of
setuptools reaches it. An editable install reads the folder itself.
"""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithData(build_py):
    """Copy the data package into the package when a wheel is built."""

    def _data(self) -> dict[str, str]:
        target = Path(self.build_lib) / "lissome" / "_data"
        return {
            str(target / source.relative_to("data")): str(source)
            for pattern in ("*.csv", "datapackage.json", "projects/*.json")
            for source in sorted(Path("data").glob(pattern))
        }

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        for target, source in self._data().items():
            self.mkpath(str(Path(target).parent))
            self.copy_file(source, target)

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        return super().get_outputs(include_bytecode) + (
            [] if self.editable_mode else list(self._data())
        )


setup(cmdclass={"build_py": BuildWithData})
