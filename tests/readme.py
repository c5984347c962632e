"""The README, as the tests read it."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def cluster_commands() -> list[str]:
    """The lines of the block that installs the operator, a continued line as one, comments left out."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    (block,) = [each for each in blocks if "helm install" in each]
    return [re.sub(r"\s+# .*", "", line) for line in block.replace("\\\n ", "").splitlines()]
