"""Draw the particles of a run at one or more times.

usage: python postproc/plot_particles.py DIR [--time T ...] [--field pressure|speed|fluid|surface] [--frame tank]

The same as `python -m parmps plot particles`: reads DIR/particles.vtkhdf, also while the run goes on, takes the
frames nearest to the times (the last one by default) and writes DIR/particles_FIELD.png. Of a 3D run it draws the
layer in the middle of the width.
"""

import sys

from parmps.cli import main

if __name__ == "__main__":
    sys.argv[1:1] = ["plot", "particles"]
    main()
