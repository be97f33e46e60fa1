# SPDX-License-Identifier: BSD-2-Clause
"""Files of the layered standard FMI-LS-REF 1.0.0-beta.1: reference outputs of an FMU with
unconnected inputs, with which an importer can compare its own results.
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
    """Return the files of the standard, as bytes by name, for a trace (CSV with the outputs).

    Return {} if the trace is empty. It is empty for an FMU whose outputs violate their declared
    range with unconnected inputs, and without the option --trace of package_fmu.py.
    """
    if not trace:
        return {}
    return {f"{FOLDER}/fmi-ls-manifest.xml": MANIFEST.encode(), f"{FOLDER}/reference.csv": trace}
