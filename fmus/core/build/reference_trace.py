# SPDX-License-Identifier: BSD-2-Clause
"""Files of the layered standard FMI-LS-REF 1.0.0-beta.1: outputs of the FMU with its inputs
unconnected, with which an importer can compare.
"""

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"

MANIFEST = """<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"
  fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-beta.1"
  fmi-ls:fmi-ls-description="Layered Standard providing information on related files included in an FMU.">
  <Related type="text/csv" source="reference.csv" role="result"
    description="outputs every 5 s of the default experiment, with the start values of all inputs"/>
</fmiReferences>
"""  # noqa: E501


def reference_files(trace: bytes) -> dict[str, bytes]:
    """Return the contents by name; none without a trace, which exists only if no output of the
    unconnected FMU violates its declared range.
    """
    if not trace:
        return {}
    return {f"{FOLDER}/fmi-ls-manifest.xml": MANIFEST.encode(), f"{FOLDER}/reference.csv": trace}
