#pragma once

#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/residual.hpp"
#include "models/system.hpp"
#include "orbits/error_form.hpp"
#include "orbits/series.hpp"

namespace orbid::orbits {

/// How well the end of one interval has to meet the beginning of the next: s_{i+1} = Phi(s_i; theta) + error.
struct Matching {
    enum class Kind {
        exact,     ///< equality constraints
        normal,    ///< normal errors
        student_t  ///< Student's t with `dof`: an interval on the wrong branch of a fold does not hold the others
    };
    Kind kind = Kind::exact;
    Eigen::VectorXd sd;     ///< shape (n), in the coordinates' units, > 0; not read for exact matching
    bool estimate = false;  ///< sds are starts of estimated scales
    double dof = 4.0;       ///< student_t
};

struct ShootingOptions {
    std::string name = "series";                ///< prefix of group names: "series.phi", "series.matching.phi"
    std::vector<std::string> observe;           ///< coordinates of the series that count; empty = all of them
    std::vector<std::size_t> segments;          ///< indices of the segments to fit; empty = all
    models::Sensor sensor;                      ///< how the series was read
    std::vector<estimator::ErrorScale> errors;  ///< one per observed coordinate; empty = all estimated
    std::vector<ErrorForm> forms;               ///< likewise; empty = all normal with one sd
    Matching matching;
    /// Sampling intervals (sections) from node to node, > 0; 0: chosen by how errors grow, see interval().
    Eigen::Index interval = 0;
    Eigen::VectorXd start;               ///< estimator's parameters at which nodes are guessed; empty = base
    std::vector<Eigen::MatrixXd> nodes;  ///< known nodes per fitted segment, shape (n, nodes); empty: from the data
    models::FlowOptions flow{1e-11, 1e-11, 100000};
};

/// The recorded series itself by multiple shooting (Bock 1987, Baake 1992): nodes s_i along every segment,
///
///     e = y_k - sensor(Phi(s_i, t_i -> t_k; theta))    for all readings of interval i
///     s_{i+1} = Phi(s_i, t_i -> t_{i+1}; theta)        exactly (constraints) or with errors of their own (Matching)
///
/// One block per node, chained along a segment; latent states: the node. Sections of forced models and maps, samples,
/// and crossings with times of autonomous flows as samples at those times. Of an angle_difference sensor the residuals
/// are the two angle readings, which have independent errors, not the angle and the quotient, which share one: group
/// "<name>.<angle>". Missing samples have no record; angles are compared modulo a turn.
class ShootingResidual final : public estimator::Residual {
public:
    /// @throws std::invalid_argument naming value and rule, as SeriesResidual.
    ShootingResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding, Series series,
                     ShootingOptions options);

    /// The same residual with other matching, started from these latent states (empty: its own). Shares the data.
    [[nodiscard]] ShootingResidual with(const Matching& matching, std::vector<Eigen::VectorXd> latents) const;

    [[nodiscard]] std::string_view type() const override { return "series"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override;
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport refresh(const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                                     const Eigen::VectorXd& scales) override;
    void suspend(std::size_t block) override { layout_.at(block).active = false; }

    /// Root mean square of the matching defect s_{i+1} - Phi(s_i) per coordinate, shape (n), and its robust size:
    /// 1.4826 times the median of its absolute value.
    struct Defect {
        Eigen::VectorXd rms;
        Eigen::VectorXd typical;
        std::size_t large = 0;  ///< intervals with a coordinate beyond three of the `sd` given
        std::size_t count = 0;  ///< intervals
    };
    [[nodiscard]] Defect defect(const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                                const Eigen::VectorXd& sd) const;
    /// Sampling intervals from node to node, as given or chosen.
    [[nodiscard]] Eigen::Index interval() const;

private:
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

}  // namespace orbid::orbits
