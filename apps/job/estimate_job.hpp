#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "apps/job/column_job.hpp"
#include "apps/job/orbit_start.hpp"
#include "estimator/exploration/record_draws.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/prior.hpp"
#include "estimator/interface/residual.hpp"
#include "identification/problem/identification_problem.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::apps {

/// As jobs write them, in the order of estimator::Scale.
inline const std::vector<std::string> scale_names{"linear", "log", "log10", "logit"};
/// In the order of estimator::Variance.
inline const std::vector<std::string> variance_names{"ml", "restricted", "integrated"};
/// In the order of estimator::ErrorDistribution.
inline const std::vector<std::string> distribution_names{"normal",    "student_t", "laplace",
                                                         "lognormal", "relative",  "ar1"};

/// Key and value of the parameter that an error distribution has beside its scale; nullptr: none.
template <class Distribution>
[[nodiscard]] auto error_shape(Distribution& distribution) {
    using Parameter =
        std::conditional_t<std::is_const_v<Distribution>, const estimator::ErrorParameter, estimator::ErrorParameter>;
    std::pair<std::string, Parameter*> shape{"", nullptr};
    if (auto* student = std::get_if<estimator::StudentErrors>(&distribution)) shape = {"dof", &student->dof};
    if (auto* relative = std::get_if<estimator::RelativeErrors>(&distribution))
        shape = {"relative", &relative->relative};
    if (auto* chain = std::get_if<estimator::AutoregressiveErrors>(&distribution))
        shape = {"correlation", &chain->correlation};
    return shape;
}

using FreeParameterJob = identification::FreeModelParameter;
using DerivedJob = identification::ModelQuantity;
using ErrorJob = identification::RecordErrors;
using CovarianceJob = identification::JointErrors;

struct CyclesResidualJob {
    std::vector<int> periods;
    bool covariance = true;        ///< weights: the analysis' covariance times a factor; false: equal, a sd
    bool positions = true;         ///< the points are data
    bool multipliers = false;      ///< ln|multiplier| is data; at least one of the three
    bool times = false;            ///< T is data: autonomous models
    std::vector<ErrorJob> errors;  ///< one per coordinate of the model, in their order
    std::vector<CovarianceJob> covariances;
    estimator::ErrorScale multiplier_error{true, 0.0, estimator::FlatPrior{}};  ///< as ErrorJob::scale
    estimator::ErrorScale time_error{true, 0.0, estimator::FlatPrior{}};        ///< likewise
};

using MatchingJob = identification::Matching;
using SeriesResidualJob = identification::SeriesChoice;
using WaveformResidualJob = identification::WaveformChoice;

/// A file of amplitudes and frequencies that were measured over a parameter.
struct BranchResidualJob {
    std::optional<std::filesystem::path> file;  ///< absolute
    std::string sha256;                         ///< of `file`, expected; empty: not given
    Eigen::Index parameter = -1;                ///< of the model; < 0: refused
    ColumnJob at;                               ///< its column; `coordinate` has no meaning
    double at_sd = 0.0;                         ///< of its errors; 0: exact
    std::vector<periodic::OrbitReading> readings;
    struct Measure {
        periodic::OrbitMeasure measure = periodic::OrbitMeasure::half_range;
        ColumnJob column;  ///< of the coordinate, or n + i of `readings`; of the frequency without meaning
        ErrorJob error;
    };
    std::vector<Measure> measures;
    OrbitStart orbit;                                ///< of the branch, at the job's own values; forced: at phase 0
    std::optional<std::pair<double, double>> range;  ///< over which the branch is followed

    /// Name and unit of what is read of the motions: a coordinate, or reading `index` - n.
    [[nodiscard]] std::pair<std::string, std::string> quantity(const models::System& system, Eigen::Index index) const {
        if (index < system.dimension()) {
            const models::Coordinate& coordinate = system.coordinates()[static_cast<std::size_t>(index)];
            return {std::string(coordinate.name), std::string(coordinate.unit)};
        }
        const periodic::OrbitReading& reading = readings[static_cast<std::size_t>(index - system.dimension())];
        return {reading.name, reading.unit};
    }
    /// "h.half_range", "frequency".
    [[nodiscard]] std::string measure_name(const models::System& system, periodic::OrbitMeasure measure,
                                           Eigen::Index index) const {
        const std::string& name = periodic::name_of(measure);
        return measure == periodic::OrbitMeasure::frequency ? name : quantity(system, index).first + "." + name;
    }
};

using identification::ResidualType;
using StageJob = identification::Stage;

/// As jobs write them, in the order of ResidualType.
inline const std::vector<std::string> residual_type_names{"cycles", "series", "waveform", "branch"};

/// Other models that the estimate is compared with.
struct CriticismJob {
    std::vector<std::string> variants;  ///< of the model, other than the job's
    std::vector<Eigen::Index> without;  ///< parameters of the estimate, set to 0 one at a time
    double held_out = 0.0;              ///< share of the data left out in turn and predicted; 0: none

    [[nodiscard]] bool any() const { return !variants.empty() || !without.empty() || held_out > 0.0; }
};

/// Estimates from several starts; 1 = only the job's.
struct MultiStartJob {
    std::size_t starts = 1;
    std::uint64_t seed = 1;  ///< the job's, unless another is given
};

/// Draws from the posterior density; 0 draws: none.
struct SampleJob {
    std::size_t draws = 0;   ///< per chain, after the warm-up
    std::size_t chains = 4;  ///< >= 2: their agreement is tested
    std::size_t warm_up = 500;
};

/// Intervals by simulation; 0 replicates: none.
struct IntervalsJob {
    static constexpr std::size_t least = 40;  ///< replicates: the ends of a 95 % interval lie among them
    std::size_t bootstrap = 0;
    estimator::ErrorDraw kind = estimator::ErrorDraw::automatic;
};

/// A selection of estimated parameters.
struct ParameterChoice {
    bool all = false;
    std::vector<std::string> names;  ///< of the estimate's parameters, unless all

    [[nodiscard]] bool any() const { return all || !names.empty(); }
    /// Also for every segment of an initial value named without one.
    [[nodiscard]] bool contains(const std::string& name) const;
};

struct EstimateJob {
    std::vector<FreeParameterJob> parameters;
    std::vector<estimator::JointNormalPrior> joint_priors;
    std::vector<DerivedJob> derived;
    std::optional<CyclesResidualJob> cycles;
    std::optional<SeriesResidualJob> series;
    std::optional<WaveformResidualJob> waveform;
    std::optional<BranchResidualJob> branch;
    bool automatic = false;          ///< "strategy": "auto"
    bool usual_residuals = false;    ///< none were given: "auto" has chosen them
    std::vector<StageJob> strategy;  ///< in this order; each residual is used in at least one of them
    bool scan = false;               ///< the prediction starts with a coarse scan of the parameters over their bounds
    CriticismJob criticism;
    estimator::Variance variance = estimator::Variance::restricted;
    MultiStartJob multi_start;
    SampleJob sample;
    IntervalsJob intervals;
    ParameterChoice profile;
    ParameterChoice marginals;

    /// Those of the residuals that are there, in order.
    [[nodiscard]] std::vector<ResidualType> residual_types() const;
};

}  // namespace orbid::apps
