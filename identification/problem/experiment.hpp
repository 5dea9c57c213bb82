#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/prior.hpp"
#include "models/definition/input_signal.hpp"
#include "models/definition/sensor.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// Value of one parameter, for one experiment.
struct ParameterValue {
    Eigen::Index parameter;  ///< index into System::parameters()
    double value;
};

/// Where one coordinate of a segment's initial state comes from.
struct InitialValue {
    bool estimate = true;
    std::optional<double> value;  ///< fixed value, or start when estimated; empty: start from the data
    estimator::Prior prior = estimator::FlatPrior{};
    estimator::Scale scale = estimator::Scale::linear;
    double lower = -std::numeric_limits<double>::infinity();
    double upper = std::numeric_limits<double>::infinity();

    /// It has settings that a latent state cannot have. It becomes a parameter of the estimate, one per segment, named
    /// by initial_parameter_name.
    [[nodiscard]] bool is_parameter() const {
        const bool plain = std::holds_alternative<estimator::FlatPrior>(prior) ||
                           std::holds_alternative<estimator::NormalPrior>(prior);
        return estimate && !(plain && scale == estimator::Scale::linear && std::isinf(lower) && std::isinf(upper));
    }
};

/// Scale and lower bound that the prior implies: logarithmic above 0, where it allows positive values alone.
void set_default_scale(InitialValue& value);

/// "u_0@run1": a coordinate's value at the first sample of an experiment. With several fitted segments ".LABEL"
/// follows.
[[nodiscard]] inline std::string initial_parameter_name(const std::string& coordinate, const std::string& experiment) {
    return coordinate + "_0@" + experiment;
}

/// Measured inputs: one signal per segment of a series; empty when the model reads none.
using Inputs = std::vector<std::shared_ptr<const models::InputSignal>>;

/// One record and the conditions under which it was made.
struct Experiment {
    std::string name = "data";  ///< in names of parameters and in messages
    std::shared_ptr<const orbits::Series> series;
    Inputs inputs;
    models::Sensor sensor;
    std::vector<Eigen::Index> observe;            ///< coordinates used as data, ascending; empty: those of the series
    std::vector<ParameterValue> parameters;       ///< values for this experiment only
    std::vector<Eigen::Index> free;               ///< parameters estimated for this experiment only (name@experiment)
    std::optional<std::vector<std::string>> fit;  ///< labels of segments; empty = all not in `predict`
    std::vector<std::string> predict;             ///< labels of segments predicted, not fitted
    std::vector<InitialValue> initial_state;      ///< one per coordinate of the model; empty: all estimated
    /// Parameter of the model that is the delay of the inputs [s], which are given undelayed: the model reads
    /// u(t - delay).
    std::optional<Eigen::Index> delay = {};
    bool follows_model = false;  ///< simulated by this model: nodes are matched exactly unless told otherwise

    /// Whether a parameter is estimated for this experiment only.
    [[nodiscard]] bool has_own(Eigen::Index parameter) const;
    /// All parameters, with its own values among these.
    [[nodiscard]] Eigen::VectorXd with_own(Eigen::VectorXd values) const;
    /// Indices of the segments with these labels, in the order of the labels.
    /// @throws orbits::DataError naming experiment and label of a missing segment.
    [[nodiscard]] std::vector<std::size_t> segments_with(const std::vector<std::string>& labels) const;
    /// Indices of the segments that are fitted: the named ones, or all that are not predicted.
    /// @throws orbits::DataError as segments_with.
    [[nodiscard]] std::vector<std::size_t> fitted_segments() const;
};

}  // namespace orbid::identification

#pragma GCC visibility pop
