"""Draw the probe signals of a run: one panel a quantity, force and moment by component.

usage: python postproc/plot_probes.py DIR [--reference FILE.csv] [--show]

The same as `python -m parmps plot probes`: reads DIR/probes.csv, also while the run goes on, and writes
DIR/probes.png. A reference file has the same form: `time [s]`, then columns `name [unit]`; each is drawn in black
in the panel of its quantity.
"""

import sys

from parmps.cli import main

if __name__ == "__main__":
    sys.argv[1:1] = ["plot", "probes"]
    main()
