r"""Linear-elastic model of a free film: strain proportional to the square of the field, with a constant modulus.

.. math:: s_z = -\frac{\varepsilon E^2}{Y}, \qquad s_{xy} = \frac{\varepsilon E^2}{2Y}

It is the baseline of all rigs. Whether it is valid below 10 % strain, as thesis 2.2 has it, depends on which field
is put in. Of a neo-Hookean film with the thickness strain -e it gives

- with the true field, voltage over the present thickness: :math:`e + e^3/3 + O(e^4)`, right to 0.4 % of the strain
  at 10 % and still to 7 % at pull-in (e = 37 %); the strain along the film, 5.4 % there, it gives 7 % too small;
- with the nominal field, voltage over the undeformed thickness: :math:`e - 2e^2 + O(e^3)`, 19 % too small at 10 %
  and less than half of what is there at pull-in, which it does not know.

So a strain below 10 % is well explained by a field, and a good deal less well by a voltage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from deatwin.plant.laws.dielectric import maxwell_strain
from deatwin.plant.material import Material


@dataclass(frozen=True, kw_only=True)
class LinearElastic:
    """Free film of constant modulus, permittivity and thickness.

    Parameters
    ----------
    elastic_modulus : float
        Y in Pa; three times the shear modulus of an incompressible film.
    permittivity : float
        Relative permittivity.
    thickness : float
        Undeformed thickness, m.

    Examples
    --------
    >>> film = LinearElastic(elastic_modulus=75e3, permittivity=4.5, thickness=0.5e-3)
    >>> f"{film.thickness_strain(film.nominal_field(4e3)):.4f}"
    '-0.0340'
    """

    elastic_modulus: float
    permittivity: float
    thickness: float

    @classmethod
    def of(cls, substance: Material, thickness: float) -> Self:
        """Return the linear model of a material at small strain, with all branches relaxed.

        Parameters
        ----------
        substance : Material
            Material with its published values.
        thickness : float
            Undeformed thickness, m.

        Returns
        -------
        LinearElastic
        """
        return cls(
            elastic_modulus=3 * substance.shear_modulus, permittivity=substance.permittivity.value, thickness=thickness
        )

    def nominal_field(self, voltage: Any) -> Any:
        """Return the voltage divided by the undeformed thickness.

        Parameters
        ----------
        voltage : float or array
            Film voltage, V.

        Returns
        -------
        float or array
            V/m.
        """
        return voltage / self.thickness

    def thickness_strain(self, field: Any) -> Any:
        """Return the strain across the film.

        Parameters
        ----------
        field : float or array
            Field across the film, V/m.

        Returns
        -------
        float or array
            Strain, dimensionless, not above 0.
        """
        return maxwell_strain(self.permittivity, field, self.elastic_modulus)

    def in_plane_strain(self, field: Any) -> Any:
        """Return the strain in the plane of the film, equal in both directions.

        Parameters
        ----------
        field : float or array
            Field across the film, V/m.

        Returns
        -------
        float or array
            Strain, dimensionless, not below 0.
        """
        return -self.thickness_strain(field) / 2
