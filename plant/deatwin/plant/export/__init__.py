"""Plants for other programs: functional mock-up units and C source."""

from deatwin.plant.export.cosimulation import export_cosimulation
from deatwin.plant.export.model_exchange import export_model_exchange
from deatwin.plant.export.plant_step import plant_source
from deatwin.plant.export.sampled import SampledSource

__all__ = ["SampledSource", "export_cosimulation", "export_model_exchange", "plant_source"]
