#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/definition/sensor.hpp"
#include "periodic/branches/orbit_across.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/waveforms/orbit_measures.hpp"
#include "periodic/waveforms/steady_state_residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// One measure of all motions of a branch: one group of errors.
struct BranchChannel {
    OrbitMeasure measure = OrbitMeasure::half_range;
    /// In whose place the sensor reads, or n + i for BranchOptions::readings[i]; without meaning for the frequency.
    Eigen::Index coordinate = 0;
    estimator::ErrorScale scale{true, 0.0, estimator::FlatPrior{}};  ///< start 0: from the residuals
    estimator::ErrorDistribution distribution = estimator::NormalErrors{};
    double floor = 0.0;      ///< least value of an estimated scale, >= 0
    bool known_sds = false;  ///< the scale is a factor on MeasuredOrbit::deviations
};

/// A periodic motion of which amplitudes and frequency were measured, stable or unstable.
struct MeasuredOrbit {
    std::string label;  ///< names it in messages and reports: "U = 14.9"
    /// Values of the parameters that hold here, and which of them are estimated.
    models::ParameterBinding binding;
    Eigen::VectorXd values;      ///< shape (channels); nan = not measured
    Eigen::VectorXd deviations;  ///< known sds, shape (channels); empty: none is known
    /// Orbits of the model that may be this one, at the start: points at phase 0, or a state and T. Of those that
    /// Newton's method comes to from here the one with the least misfit is taken, if it resembles the motion.
    std::vector<StartingSolution> starts;
    /// Where the parameter is not known exactly: its value at each of `starts`; empty: the one in `binding`.
    std::vector<double> starts_at{};
};

/// Orbits of the model that may be a measured one, as in MeasuredOrbit.
struct BranchStarts {
    std::vector<StartingSolution> orbits;
    std::vector<double> at;
};

struct BranchOptions {
    std::string name = "branch";          ///< prefix of group names: "branch.x.half_range", "branch.frequency"
    std::vector<BranchChannel> channels;  ///< at least one, all different
    models::Sensor sensor;                ///< of all motions
    Eigen::VectorXd start;                ///< the estimator's vector at which the first solutions are computed
    double maximum_move = 0.1;            ///< of a point of an orbit from its prediction, relative to its size; > 0
    models::FlowOptions flow{1e-12, 1e-12, 100000};
    /// Orbits of the model at another vector of the estimator that may be those measured, per motion; empty: none.
    /// Asked where an estimate ends: near a fold a motion may have been taken for the other one, or for none.
    std::function<std::vector<BranchStarts>(const Eigen::VectorXd& theta)> starts{};
    /// The parameter over which motions were measured, index into System::parameters(), and the sd of its measured
    /// values, those in the bindings' bases. 0: they are exact, and the parameter has no role of its own.
    Eigen::Index parameter = -1;
    double parameter_sd = 0.0;
    std::vector<OrbitReading> readings{};  ///< formulas that are measured beside coordinates
};

/// The word of a measure, as in group names: "half_range".
[[nodiscard]] const std::string& name_of(OrbitMeasure measure);

/// Amplitudes and frequencies that were measured along a branch of periodic motions, over a parameter of the system,
/// against computed ones:
///
///     e_c = y_c - m_c(x*(theta)),    m: an OrbitMeasure of a reading of the orbit x*
///
/// One block per motion. Where the parameter u was measured with an error, e_u = u - u* joins the block, and the block
/// has one latent state, the place z of the motion on the branch: of limit cycles the true value of the first of its
/// measures, of forced motions how far their points have moved along the branch since the start, relative to the
/// motion. The orbit at that place is solved for together with its parameter u*. So motions pass folds, where a given
/// parameter has two orbits or none. Without such an error there are no latent states. The orbits are followed as
/// SteadyStateResidual says. What counts is the motion itself, not its stability: unstable orbits, as control-based
/// continuation measures them, are data like others.
class BranchResidual final : public SteadyStateResidual {
public:
    /// @throws std::invalid_argument naming value and rule. Model: one with measured inputs, or a map. No motion or
    ///         channel, two equal channels, bindings and starts of wrong lengths, options out of range.
    /// @throws models::DataError naming motion, value and rule: wrong shapes; no measure at all, or an infinite one;
    ///         log-normal errors of a measure not > 0; known sds that are missing.
    BranchResidual(std::shared_ptr<const models::System> system, std::vector<MeasuredOrbit> orbits,
                   BranchOptions options);

    [[nodiscard]] std::string_view type() const override { return "branch"; }
    [[nodiscard]] estimator::LatentStructure structure() const override {
        return moves_parameter() ? estimator::LatentStructure::independent_blocks : estimator::LatentStructure::none;
    }
    /// The parameter was measured with an error: the last residual of each block.
    [[nodiscard]] bool moves_parameter() const { return options_.parameter_sd > 0.0; }
    [[nodiscard]] Eigen::Index parameter() const { return options_.parameter; }
    [[nodiscard]] const std::vector<MeasuredOrbit>& orbits() const { return orbits_; }
    [[nodiscard]] const std::vector<BranchChannel>& channels() const { return options_.channels; }
    /// The channel of each residual of a block.
    [[nodiscard]] std::vector<std::size_t> sources(std::size_t block) const;
    /// Name and unit of what a channel measures: "x.half_range".
    [[nodiscard]] std::pair<std::string, std::string> quantity(const BranchChannel& channel) const;

private:
    struct PredictedOrbit {
        StartingSolution start;
        double parameter = 0.0;
        BranchDirection direction;  ///< of the branch
    };
    /// Measures of an orbit, with derivatives by the columns of its sensitivities. Shapes (m), (m, columns).
    struct Measures {
        bool found = false;
        Eigen::VectorXd values;
        Eigen::MatrixXd slopes;
    };
    /// The place of an orbit on its branch, and its derivatives by the columns of the orbit's sensitivities.
    struct Place {
        bool found = false;
        double value = 0.0;
        Eigen::RowVectorXd slope;
    };
    void check_channels() const;
    void check_orbit(const MeasuredOrbit& orbit) const;
    [[nodiscard]] estimator::Group make_group(const BranchChannel& channel) const;
    [[nodiscard]] estimator::Group make_parameter_group() const;
    [[nodiscard]] estimator::BlockLayout make_layout(std::size_t block) const;
    [[nodiscard]] FoundStart find_start(std::size_t block, const Eigen::VectorXd& theta) const override;
    /// The best of these starts.
    [[nodiscard]] FoundStart best_of(std::size_t block, const BranchStarts& starts, const Eigen::VectorXd& theta) const;
    [[nodiscard]] FoundStart started_from(std::size_t block, const StartingSolution& start, double at,
                                          const Eigen::VectorXd& theta) const;
    int seek_again(estimator::ActiveSet& active, const Eigen::VectorXd& theta) const override;
    [[nodiscard]] Eigen::VectorXd placed(std::size_t block, const Eigen::VectorXd& theta,
                                         const Eigen::VectorXd& latents) const override;
    [[nodiscard]] Eigen::VectorXd starting_latents(std::size_t block, const Known& known) const override;
    [[nodiscard]] FollowedOrbit spread(std::size_t block, FollowedOrbit orbit) const override;
    [[nodiscard]] FollowedOrbit solve_near(std::size_t block, const Known& from, const Eigen::VectorXd& place,
                                           bool derivatives) const override;
    /// The latent states in a place.
    [[nodiscard]] Eigen::VectorXd latents_of(const Eigen::VectorXd& place) const;
    /// The parameters of the model at an orbit of this block.
    [[nodiscard]] Eigen::VectorXd values_at(std::size_t block, const Eigen::VectorXd& theta, double parameter) const;
    [[nodiscard]] static PredictedOrbit predicted_orbit(const FollowedOrbit& from, const Eigen::VectorXd& step,
                                                        bool autonomous);
    /// The orbit on the plane through a predicted one across the branch. Sensitivities: within the plane by the free
    /// parameters, then along the branch.
    [[nodiscard]] FollowedOrbit across(const Eigen::VectorXd& values, const PredictedOrbit& predicted,
                                       std::span<const Eigen::Index> free, const Eigen::VectorXd& scale) const;
    /// Where places of forced motions are counted from: points and the direction of the branch.
    [[nodiscard]] PhaseOrigin origin_at(const FollowedOrbit& orbit, const Eigen::VectorXd& scale) const;
    [[nodiscard]] Place place_of(std::size_t block, const PhaseOrigin& origin, const Eigen::VectorXd& values,
                                 const FollowedOrbit& orbit, std::span<const Eigen::Index> free) const;
    /// The orbit at a place; sensitivities along the branch alone.
    [[nodiscard]] FollowedOrbit at_place(std::size_t block, const Known& from, const Eigen::VectorXd& theta,
                                         double wanted, PredictedOrbit predicted) const;
    [[nodiscard]] Measures measured(std::size_t block, const Eigen::VectorXd& values, const FollowedOrbit& orbit,
                                    std::span<const Eigen::Index> free, bool derivatives) const;
    /// The place instead of the arclength in the last column of derivatives.
    [[nodiscard]] FollowedOrbit by_place(std::size_t block, const PhaseOrigin& origin, const Eigen::VectorXd& values,
                                         FollowedOrbit orbit) const;
    [[nodiscard]] estimator::BlockValue value(std::size_t block, const Known& known, const FollowedOrbit& orbit,
                                              const Eigen::VectorXd& theta, const Eigen::VectorXd& latents,
                                              bool derivatives) const override;
    /// Of a block's measures, relative to their size: mean square.
    [[nodiscard]] double misfit(std::size_t block, const estimator::BlockValue& value) const;

    std::vector<MeasuredOrbit> orbits_;
    BranchOptions options_;
    Eigen::VectorXd spread_;  ///< of each channel over all motions: its mean square
};

}  // namespace orbid::periodic

#pragma GCC visibility pop
