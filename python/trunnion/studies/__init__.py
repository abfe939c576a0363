"""Parameter sweeps: a full factorial grid with random draws at each node, on any executor.

A study says what one node does (:mod:`.study`, the built-in ones in one file each); the grid is
checked before anything runs (:mod:`.grid`); blocks of samples go to this process or to an executor
and come back in any order (:mod:`.run`) into arrays and a file (:mod:`.store`), and at the end into
a labelled dataset (:mod:`.dataset`).
"""

from trunnion.probing.length import smallest_length_mm as smallest_length_mm
from trunnion.studies.dataset import open_sweep as open_sweep
from trunnion.studies.executors import RayExecutor as RayExecutor
from trunnion.studies.run import sweep as sweep
from trunnion.studies.study import STUDIES as STUDIES
from trunnion.studies.study import Block as Block
from trunnion.studies.study import FunctionStudy as FunctionStudy
from trunnion.studies.study import Output as Output
from trunnion.studies.study import Parameter as Parameter
from trunnion.studies.study import Seeds as Seeds
from trunnion.studies.study import Study as Study
