"""How tests start ranks of MPI."""

import os
import shutil
import subprocess

# What a surrounding MPI or batch system says is not about the tests' own ranks.
FOREIGN = ("OMPI_", "PMIX_", "PMI_", "SLURM_", "ORBID_PLUGINS")
CLEAN = {name: value for name, value in os.environ.items() if not name.startswith(FOREIGN)}


def starter():
    """The command before `-n`, and the environment for it: more ranks than cores, as root too. None: no mpiexec."""
    mpiexec = shutil.which("mpiexec")
    if mpiexec is None:
        return None
    version = subprocess.run([mpiexec, "--version"], capture_output=True, text=True, check=False).stdout
    if "OpenRTE" in version or "Open MPI" in version:
        # Open MPI frees not all that it allocates, in modules that are gone when the address sanitizer counts.
        return [mpiexec, "--oversubscribe"], {**CLEAN, "OMPI_ALLOW_RUN_AS_ROOT": "1",
                                              "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
                                              "ASAN_OPTIONS": CLEAN.get("ASAN_OPTIONS", "") + ":detect_leaks=0"}
    return [mpiexec], dict(CLEAN)
