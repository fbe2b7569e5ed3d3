"""KPF, UPF, QKPF and P-QKPF: a Gaussian filter for each particle as the proposal."""

from abc import abstractmethod
from dataclasses import replace
from functools import partial

from vtrack_ros.estimation import (
    ConstantVelocity, gauss_hermite, GaussianFilter, GaussianFilterProposal, KalmanFilter,
    Proposal, pruned_gauss_hermite, SigmaPointFilter, unscented)
from vtrack_ros.localisation.filter_parameters import WEIGHTING
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.replicas.box_filter import BOX_PARAMETERS, BoxParticleFilter
from vtrack_ros.replicas.fusion import FusionRule, normalised_masses

_QUADRATURE = ParameterTable([
    *(replace(BOX_PARAMETERS[name], default=default) for name, default in (
        ('cues', 'colour+motion_edge'), ('kernel', 'epanechnikov'), ('threshold', 0.5))),
    Parameter('order', 3, 'Number of Gauss-Hermite points per dimension; more take more time per '
              'frame.', 2, 7),
    Parameter('as_printed', False, 'Run the method as printed: weighting full, a covariance that '
              'each particle keeps from frame to frame, and fusion normalised in place of '
              'dempster_shafer. Takes effect with the next target or ~/reinit.'),
])


class MeasuredParticleFilter(BoxParticleFilter):
    """
    Each particle is drawn from the posterior N(x_i, P_i) of a filter of its own [Qi2012, sec. 2].

    Printed: the filter of a particle keeps its covariance between steps, and the weight is
    w_prev p(z|x) p(x|x_prev) / q(x|x_prev, z) [Zhu2012, eq. 5; Qi2012, sec. 2.2 d].

    Corrected: a particle's own filter starts from the particle, which is known, so with zero
    covariance; one that is kept counts the uncertainty of x_prev twice, in itself and in the
    spread of the particles. And the weight is the likelihood alone, for the measurement and the
    likelihood are of the same pixels, and with a ratio of densities in six dimensions few
    particles keep any weight; `weighting=full` has it. `as_printed` has both as printed. The
    estimate is the weighted mean before resampling; [Qi2012, sec. 2.2 f] takes a sample of that.
    """

    PARAMETERS = BOX_PARAMETERS + WEIGHTING + ParameterTable([
        Parameter('as_printed', False, 'Run the method as printed: weighting full, and a '
                  'covariance that each particle keeps from frame to frame. Takes effect with '
                  'the next target or ~/reinit.')])
    _measures = True

    @abstractmethod
    def _gaussian_filter(self, model: ConstantVelocity) -> GaussianFilter:
        """Return the filter of a particle."""

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        return GaussianFilterProposal(
            self._gaussian_filter(model), 'kept' if self._as_printed else 'reset')

    def _weighting(self) -> str:
        return 'full' if self._as_printed else super()._weighting()


class KalmanReplica(MeasuredParticleFilter):
    """KPF: a Kalman filter for each particle, the baseline of [Zhu2012, sec. 5]."""

    NAME = 'kpf_paper'
    SUMMARY = 'Kalman particle filter (KPF), the baseline of Zhu et al. 2012'

    def _gaussian_filter(self, model: ConstantVelocity) -> GaussianFilter:
        return KalmanFilter(model)


class UnscentedReplica(MeasuredParticleFilter):
    """UPF: an unscented Kalman filter for each particle, the baseline of [Zhu2012, sec. 5]."""

    NAME = 'upf_paper'
    SUMMARY = 'unscented particle filter (UPF), the baseline of Zhu et al. 2012'

    def _gaussian_filter(self, model: ConstantVelocity) -> GaussianFilter:
        return SigmaPointFilter(model, unscented)


class QuadratureReplica(MeasuredParticleFilter):
    """
    QKPF: a quadrature Kalman filter for each particle, two cues [Qi2012].

    Printed of the cues: each one's weights are normalised over the particles, and combined by
    Dempster's rule as if they were probabilities of one particle being the target (eqs 16-19).
    With masses of about 1/N that is close to the product.

    Corrected (`fusion=dempster_shafer`): likelihoods are divided by the highest, a cue is
    discounted the less it tells the particles apart (Shafer's discounting), and half of the
    unknown mass is the target's; see `replicas.fusion`. `fusion=normalised` has eqs 16-19 as
    printed but for the misprint in eq. 18, see `normalised_masses`; `as_printed` has it in place
    of `dempster_shafer`, and does the same as in `MeasuredParticleFilter`.
    """

    NAME = 'qkpf_paper'
    SUMMARY = 'quadrature Kalman particle filter (QKPF), the baseline of Qi and Li 2012'
    PARAMETERS = BOX_PARAMETERS + WEIGHTING + _QUADRATURE

    def _gaussian_filter(self, model: ConstantVelocity) -> GaussianFilter:
        rule = partial(gauss_hermite, order=int(self._parameters['order']))
        return SigmaPointFilter(model, rule)

    def _fusion(self) -> FusionRule:
        if self._as_printed and self._parameters['fusion'] == 'dempster_shafer':
            return normalised_masses
        return super()._fusion()


class PrunedQuadratureReplica(QuadratureReplica):
    """
    P-QKPF: the quadrature filter without its points of small weight [Qi2012, eq. 20].

    The threshold of eq. 20 is that of two dimensions: in the six of a box it would leave only the
    centre, which is no filter. But an update integrates over the measured centre alone, which has
    two, and motion is linear: so eq. 20 is used as printed. Pruned points are left out, also with
    `as_printed`, and not regrouped by eqs 21 and 22, for which see `pruned_gauss_hermite`.
    """

    NAME = 'pqkpf_paper'
    SUMMARY = 'pruned quadrature Kalman particle filter (P-QKPF) of Qi and Li 2012'

    def _gaussian_filter(self, model: ConstantVelocity) -> GaussianFilter:
        rule = partial(pruned_gauss_hermite, order=int(self._parameters['order']))
        return SigmaPointFilter(model, rule)
