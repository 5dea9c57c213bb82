#pragma once

#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/records/error_form.hpp"
#include "orbits/records/series.hpp"
#include "orbits/series_residuals/continuity.hpp"
#include "orbits/series_residuals/shooting_plan.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct ShootingOptions {
    std::string name = "series";        ///< prefix of group names: "series.phi", "series.matching.phi"
    std::vector<std::string> observe;   ///< coordinates of the series to fit; empty = all
    std::vector<std::size_t> segments;  ///< indices of the segments to fit; empty = all
    models::Sensor sensor;              ///< how the series was read
    /// One per observed coordinate; empty = all estimated. For an angle_difference sensor the angle's applies to both
    /// readings, and the rate's is not read.
    std::vector<estimator::ErrorScale> errors;
    std::vector<ErrorForm> forms;  ///< likewise; empty = all normal with one sd
    Continuity matching;
    /// Sampling intervals (sections) from node to node, > 0; 0: chosen by how errors grow, see interval().
    Eigen::Index interval = 0;
    /// Models with measured inputs: one signal per segment of the series, see SeriesResidualOptions::inputs.
    std::vector<std::shared_ptr<const models::InputSignal>> inputs;
    Eigen::VectorXd start;               ///< estimator's parameters for the guess of nodes; empty = base
    std::vector<Eigen::MatrixXd> nodes;  ///< known nodes per fitted segment, shape (n, nodes); empty: from the data
    /// The highest accuracy used; in loose stages a small share of the matching sd is enough.
    models::FlowOptions flow{1e-12, 1e-12, 100000};
};

/// The recorded series itself by multiple shooting (Bock 1987, Baake 1992): nodes s_i along every segment,
///
///     e = y_k - sensor(Phi(s_i, t_i -> t_k; theta))    for all readings of interval i
///     s_{i+1} = Phi(s_i, t_i -> t_{i+1}; theta)        exactly or with errors of their own (Continuity)
///
/// One block per node, chained along a segment; latent states: the node. Sections of forced models and maps, samples,
/// and crossings with times of autonomous flows as samples at those times. For an angle_difference sensor the residuals
/// are the two angle readings, whose errors are independent, not the angle and the quotient, which share one. Their
/// group is "<name>.<angle>", with floor step / sqrt 12. Missing samples have no record; angles are compared modulo a
/// turn. Groups: one per observed coordinate, then "<name>.matching.<coordinate>" for every coordinate of the model.
///
/// Phases of nodes are that of the section, or series.phase + omega t; derivatives to an estimated omega are complete
/// in both. A failed flow (as in grazing) fails only its own block. A transient that ends in standstill keeps its tail:
/// the flow sticks there and X is singular, but the readings still count.
///
/// Continuity begins loose, at the root mean square defect of the nodes guessed from the data. update_active_set()
/// tightens it. is_intermediate_stage() is true until the requested tightness is reached.
class ShootingResidual final : public estimator::Residual {
public:
    /// @throws std::invalid_argument naming value and rule: coordinates or segments that do not exist or are named
    ///         twice, segments without a reading, sections of an autonomous flow without times, an unread coordinate
    ///         that no slope determines (sections) when no nodes are given, wrong lengths, an angle_difference sensor
    ///         whose angle is not observed or with known sds, log-normal or relative errors of an angle, autoregressive
    ///         errors (they would end at every node), interval < 0, measured inputs that are missing.
    ShootingResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding, Series series,
                     ShootingOptions options);

    /// The same residual with other matching, started from these latent states and parameters of the estimator (empty:
    /// its own). The data are shared.
    [[nodiscard]] ShootingResidual with(const Continuity& matching, std::vector<Eigen::VectorXd> latents,
                                        const Eigen::VectorXd& theta = {}) const;

    [[nodiscard]] std::string_view type() const override { return "series"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return start_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) override;
    void deactivate(std::size_t block) override { layout_.at(block).active = false; }
    [[nodiscard]] bool is_intermediate_stage() const override { return tightness_ > final_; }

    /// Continuity defects d = s_{i+1} - Phi(s_i), per coordinate of the model.
    struct Defect {
        Eigen::VectorXd rms;      ///< shape (n)
        Eigen::VectorXd typical;  ///< 1.4826 times the median of its absolute value: the sd if it were normal
        std::size_t large = 0;    ///< intervals with a coordinate beyond three of the given `sd`
        std::size_t count = 0;    ///< intervals
    };
    /// @param sd  shape (n), > 0; empty: the present matching sds.
    [[nodiscard]] Defect defect(const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                                const Eigen::VectorXd& sd = {}) const;

    /// Sampling intervals from node to node, as given or chosen.
    [[nodiscard]] Eigen::Index interval() const { return data_->interval; }
    /// Size of each coordinate's range, shape (n). In this unit matching is equally tight for all.
    [[nodiscard]] const Eigen::VectorXd& range() const { return data_->range; }
    /// Present matching sds, shape (n); 0 when matching is by constraints.
    [[nodiscard]] Eigen::VectorXd matching_sd() const { return tightness_ * unit_; }
    [[nodiscard]] const Continuity& matching() const { return matching_; }
    /// Largest sd of a reading over its range, as far as known.
    [[nodiscard]] double noise() const { return noise_; }
    [[nodiscard]] const Series& series() const { return data_->series; }
    [[nodiscard]] const ShootingPlan& plan() const { return data_->plan; }

private:
    /// What copies with other matching share.
    struct Data {
        /// One per segment of the series, each with its measured inputs; a single one without inputs.
        std::vector<std::shared_ptr<const models::System>> systems;
        models::ParameterBinding binding;
        Series series;
        ShootingOptions options;
        std::vector<ObservedCoordinate> observed;
        models::Sensor instant_sensor;  ///< what is read at one instant: a difference sensor reads its angle twice
        Eigen::Index interval = 1;
        Eigen::VectorXd range;
        std::vector<double> reading_range;  ///< per group of readings
        ShootingPlan plan;
        Eigen::VectorXd omega_slopes;  ///< d omega / d(parameter), per parameter of the binding

        [[nodiscard]] const models::System& system() const { return *systems.front(); }
    };
    struct Chunk;
    struct Simulated;

    static std::shared_ptr<Data> read(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                      Series series, ShootingOptions options);
    void check_matching() const;
    void guess_nodes(const Eigen::VectorXd& all);
    void make_groups();
    void make_layout();
    void begin_matching(const Eigen::VectorXd& theta);
    void apply_matching();
    void find_noise();
    void predict_scales(const Eigen::VectorXd& theta);
    void read_scales(const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents);
    [[nodiscard]] models::FlowOptions stage_flow() const;
    [[nodiscard]] Eigen::VectorXd start_theta() const;
    [[nodiscard]] Eigen::VectorXd reading_noise(const Eigen::VectorXd& all) const;
    void evaluate(const Chunk& chunk, const Eigen::VectorXd& all, const std::vector<Eigen::VectorXd>& latents,
                  bool derivatives, std::vector<estimator::BlockValue>& values) const;
    [[nodiscard]] Simulated simulated(const Chunk& chunk, const Eigen::VectorXd& all,
                                      const std::vector<Eigen::VectorXd>& latents, bool derivatives) const;
    [[nodiscard]] Eigen::MatrixXd sensitivity(const Simulated& run, Eigen::Index k, std::size_t node,
                                              Eigen::Index instant) const;
    [[nodiscard]] estimator::BlockValue value(const Simulated& run, Eigen::Index k, std::size_t b,
                                              const std::vector<Eigen::VectorXd>& latents, bool derivatives) const;
    [[nodiscard]] const models::System& system_of(std::size_t segment) const {
        return *data_->systems[data_->systems.size() == 1 ? 0 : segment];
    }

    std::shared_ptr<const Data> data_;
    Continuity matching_;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<Eigen::VectorXd> start_;
    Eigen::VectorXd unit_;    ///< matching sds over their tightness: the ranges, or in the requested proportions
    double tightness_ = 0.0;  ///< of matching, now and at the end
    double final_ = 0.0;
    double noise_ = 0.0;  ///< sd of readings over their ranges, as far as known
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
