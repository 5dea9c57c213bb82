#include "identification/prediction/motion_quantities.hpp"

#include <algorithm>
#include <complex>

#include "estimator/interface/not_finite.hpp"
#include "identification/problem/fitted_branch.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitMeasure;

using estimator::nan_value;

const VectorXd& values_of(const periodic::OrbitAmplitude& amplitude, OrbitMeasure measure) {
    switch (measure) {
        case OrbitMeasure::minimum:
            return amplitude.minimum;
        case OrbitMeasure::mean:
            return amplitude.mean;
        case OrbitMeasure::half_range:
            return amplitude.half_range;
        case OrbitMeasure::rms:
            return amplitude.rms;
        default:
            return amplitude.maximum;
    }
}

}  // namespace

VectorXd quantities_of(const MotionQuantities& asked, const periodic::PeriodicOrbit& orbit,
                       const periodic::OrbitAmplitude& amplitude) {
    VectorXd all = VectorXd::Constant(asked.count(), nan_value);
    for (int m = 0; m < static_cast<int>(OrbitMeasure::frequency); ++m) {
        const VectorXd& values = values_of(amplitude, static_cast<OrbitMeasure>(m));
        for (Index i = 0; i < std::min(asked.read(), values.size()); ++i)
            all(asked.of_measure(static_cast<OrbitMeasure>(m), i)) = values(i);
    }
    all(asked.frequency()) = 1.0 / orbit.time;
    if (!orbit.multipliers.empty()) all(asked.multiplier()) = std::abs(orbit.multipliers.front());
    if (asked.points > 0 && orbit.points.size() >= asked.points)
        all.tail(asked.points) = orbit.points.reshaped().head(asked.points);
    return all;
}

periodic::OrbitAmplitude amplitude_with_readings(const models::System& system, const VectorXd& values, double phase,
                                                 const periodic::PeriodicOrbit& orbit,
                                                 const std::vector<periodic::OrbitReading>& readings) {
    if (readings.empty()) return periodic::amplitude_of(system, values, phase, orbit, {});
    return amplitude_by_readings(system, values, orbit, readings);
}

MatrixXd quantity_slopes(const MotionQuantities& asked, const models::System& system, const VectorXd& values,
                         double phase, const periodic::PeriodicOrbit& orbit, std::span<const Index> free) {
    const auto f = std::ssize(free);
    MatrixXd slopes = MatrixXd::Constant(asked.count(), f, nan_value);
    if (asked.points > 0 && orbit.sensitivities.rows() >= asked.points)
        slopes.bottomRows(asked.points) = orbit.sensitivities.topRows(asked.points);
    if (system.kind() == models::Kind::map || phase != 0.0) {
        // T of a forced motion moves with the frequency of the forcing alone, that of a map not at all.
        slopes.row(asked.frequency()).setZero();
        const auto omega = system.forcing_frequency();
        for (Index i = 0; omega && i < f; ++i)
            if (free[static_cast<std::size_t>(i)] == *omega)
                slopes(asked.frequency(), i) = 1.0 / (orbit.time * values(*omega));
        return slopes;
    }
    const periodic::OrbitReadings along(system, values, orbit, {}, free, models::FlowOptions{}, asked.readings);
    if (!along.simulated()) return slopes;
    for (int m = 0; m <= static_cast<int>(OrbitMeasure::frequency); ++m) {
        const auto measure = static_cast<OrbitMeasure>(m);
        const Index count = measure == OrbitMeasure::frequency ? 1 : asked.read();
        for (Index i = 0; i < count; ++i)
            if (const auto value = along.measure(measure, i))
                slopes.row(asked.of_measure(measure, i)) = value->by_parameters;
    }
    return slopes;
}

}  // namespace orbid::identification
