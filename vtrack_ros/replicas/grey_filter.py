"""GMPF: the grey-prediction particle filter [Zhu2012]."""

from vtrack_ros.estimation import ConstantVelocity, GreyProposal, Proposal
from vtrack_ros.localisation.filter_parameters import WEIGHTING
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.replicas.box_filter import BOX_PARAMETERS, BoxParticleFilter

#: Components of the state: velocity -> the position that it's the derivative of; and the sizes.
_VELOCITIES, _SIZES = {2: 0, 3: 1}, (4, 5)


class GreyReplica(BoxParticleFilter):
    """
    GMPF: a grey forecast of the past estimates as the proposal [Zhu2012].

    Printed: from frame m on, particles come from N(g_k, P_k), g_k the forecast of each component
    of the state by GM(1,1) from the last m estimates (eqs 9-16), P_k the spread of the previous
    particles about it (eq. 17). The algorithm weights by the likelihood (sec. 4, step 3), eq. 5
    by prior over proposal, too: `weighting` has both.

    Misprints, always corrected, for the method can't be run with them: eqs 14 and 16, see
    `estimation.grey`. GM(1,1) isn't defined for a series that isn't positive, and the paper
    doesn't say what it does with velocities: such a series is shifted up by its own range.

    Corrected:

    - The forecast doesn't depend on where in the image the target is, and hardly on its direction:
      series are shifted to a fixed distance from zero, and a velocity is the difference of
      forecast places. As printed a target at the left is forecast otherwise than one at the right.
    - Sizes aren't forecast, for the changes in their series are noise.
    - P_k is the spread of the particles after the model of motion's transition. That of eq. 17
      contains the square of the motion but not its uncertainty.
    - A share of the particles comes from the transition prior, as in Chen et al. (2009), which
      the paper cites, for a few wrong forecasts in a row can carry away all particles.

    `as_printed` undoes these four. It keeps `floor` times the process noise in P_k: eq. 17 has
    none, and nothing keeps P_k from shrinking once resampling has made all particles the same.
    With `floor=0` as well, eqs 9-18 are run as printed but for the misprints.
    """

    NAME = 'gmpf_paper'
    SUMMARY = 'grey-prediction particle filter (GMPF) of Zhu et al. 2012'
    PARAMETERS = BOX_PARAMETERS + WEIGHTING + ParameterTable([
        Parameter('window', 5, 'Number m of past estimates that the grey model is fitted to.', 4,
                  20, unit='frames'),
        Parameter('prior_share', 0.3, 'Fraction of the particles that are drawn from the '
                  'transition prior instead of the grey forecast; ignored with as_printed.',
                  0.0, 0.9),
        Parameter('floor', 1.0, "Multiple of the motion model's process noise that is added to "
                  "the proposal's covariance; 0 in the paper (eq. 17). A larger value spreads "
                  'the particles wider.', 0.0, 100.0),
        Parameter('as_printed', False, 'Run the method as printed: every component of the state '
                  'is forecast by the printed grey formula, the covariance is that of eq. 17 '
                  '(plus floor), and no particles are drawn from the transition prior. Takes '
                  'effect with the next target or ~/reinit.'),
    ])

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        values = self._parameters
        window, densities = int(values['window']), values['weighting'] == 'full'
        floor = float(values['floor'])
        if self._as_printed:
            return GreyProposal(window, floor, None, 'forecast', densities=densities)
        return GreyProposal(
            window, floor, spread='predicted',
            prior_share=float(values['prior_share']), densities=densities,
            velocities=_VELOCITIES, steady=_SIZES)
