"""One material from several tests: pulls, cycles, relaxations, dynamic moduli."""

from deatwin.ident.materials.calibrate import calibrate_material
from deatwin.ident.materials.result import CalibratedMaterial
from deatwin.ident.materials.testfile import MaterialTests, read_material_tests
from deatwin.ident.materials.tests import MaterialTest

__all__ = ["CalibratedMaterial", "MaterialTest", "MaterialTests", "calibrate_material", "read_material_tests"]
