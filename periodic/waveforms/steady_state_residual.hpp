#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/waveforms/waveform_curve.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// An orbit that is followed. Its sensitivities, those of T too, are derivatives by its place, see placed().
struct FollowedOrbit : PeriodicOrbit {
    FollowedOrbit() = default;
    FollowedOrbit(PeriodicOrbit orbit) : PeriodicOrbit(std::move(orbit)) {}
    double parameter = 0.0;  ///< of the model, where it moves with the orbit; else without meaning
    Eigen::RowVectorXd parameter_sensitivities;
};

/// Measured periodic motions against computed ones, one block per motion: what waveforms and branches share. The orbit
/// of every block is followed while theta moves.
///
/// It comes from multiple shooting (solve_orbit), started from the solution at the last update_active_set(), moved to
/// first order with its sensitivities. Where that does not converge, up to sixteen steps are taken along the line
/// between the two parameter vectors. BlockStatus::failed means that the orbit vanished (a fold), lost its period, or
/// was reached only at `maximum_move` from its prediction; solutions() names the reason.
///
/// update_active_set() moves the solutions on to the present theta. It asks for another minimisation (three times at
/// most) where they had moved by more than `maximum_move`. Blocks whose orbit is lost there are deactivated. They
/// return, at most twice each, when it is found again. Where nothing else changes, the orbits of blocks that are still
/// lost, also of those without one at the start, are sought once more as at the start, but at the present theta. There
/// an orbit counts that resembles what was measured.
class SteadyStateResidual : public estimator::Residual {
public:
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

    /// The periodic solutions at theta, one per block, with multipliers; status tells why others did not converge.
    /// Without sensitivities. They start from the solutions that the set remembers.
    [[nodiscard]] std::vector<PeriodicOrbit> solutions(const estimator::ActiveSet& active,
                                                       const Eigen::VectorXd& theta) const;
    /// How the search for the orbit of a block at the start ended.
    [[nodiscard]] OrbitStatus start_status(std::size_t block) const { return known(initial_, block).status; }
    [[nodiscard]] const models::System& system() const { return *system_; }
    /// The parameters of a block, and which of them are estimated.
    [[nodiscard]] const models::ParameterBinding& binding(std::size_t block) const { return bindings_[block]; }

protected:
    /// The last solution of a block. The memory of a set holds it, see known().
    struct Known {
        OrbitStatus status = OrbitStatus::no_progress;  ///< at the start, or where it was sought again
        Eigen::VectorXd place;                          ///< see placed(); empty: none yet
        FollowedOrbit orbit;                            ///< sensitivities to the place
        PhaseOrigin origin;                             ///< of a waveform's phase
        Eigen::VectorXd scale;
        double phase = 0.0;  ///< at the start, with the offsets
        Eigen::VectorXd offsets;
        int taken_back = 0;
        bool sought_again = false;  ///< by seek_again()
    };
    struct FoundStart {
        Known known;
        double misfit = 0.0;  ///< mean square error, over the variance of the readings
    };
    struct Following {
        double maximum_move = 0.1;  ///< of a point of an orbit from its prediction, relative to the orbit's size
        models::FlowOptions flow{1e-12, 1e-12, 100000};
    };

    SteadyStateResidual(std::shared_ptr<const models::System> system, const Following& following)
        : system_(std::move(system)), following_(following) {}
    /// Adds a block whose orbit is to be followed.
    void add_block(const models::ParameterBinding& binding, estimator::BlockLayout layout);
    /// Finds the orbits at the start; blocks without one are inactive from the beginning.
    void find_starts(const Eigen::VectorXd& theta);

    [[nodiscard]] virtual FoundStart find_start(std::size_t block, const Eigen::VectorXd& theta) const = 0;
    /// What the orbit of a block depends on: the estimator's vector, and latent states of the block below it if the
    /// orbit moves with them.
    [[nodiscard]] virtual Eigen::VectorXd placed(std::size_t /*block*/, const Eigen::VectorXd& theta,
                                                 const Eigen::VectorXd& /*latents*/) const {
        return theta;
    }
    /// The orbit with its derivatives by its place, from those by the parameters of the block.
    [[nodiscard]] virtual FollowedOrbit spread(std::size_t block, FollowedOrbit orbit) const;
    /// The orbit at a place, from a known one, moved there to first order. Derivatives by the parameters of the block.
    [[nodiscard]] virtual FollowedOrbit solve_near(std::size_t block, const Known& from, const Eigen::VectorXd& place,
                                                   bool derivatives) const;
    /// The errors of a block whose orbit is solved.
    [[nodiscard]] virtual estimator::BlockValue value(std::size_t block, const Known& known, const FollowedOrbit& orbit,
                                                      const Eigen::VectorXd& theta, const Eigen::VectorXd& latents,
                                                      bool derivatives) const = 0;
    /// Latent states where a block starts.
    [[nodiscard]] virtual Eigen::VectorXd starting_latents(std::size_t /*block*/, const Known& /*known*/) const {
        return {};
    }

    /// Where nothing else changes: seeks orbits anew at theta, for lost blocks from what was measured, once per block.
    /// @return how many blocks have another orbit than before
    virtual int seek_again(estimator::ActiveSet& active, const Eigen::VectorXd& theta) const;

    [[nodiscard]] static estimator::BlockValue failed();
    [[nodiscard]] static Known known(const estimator::ActiveSet& active, std::size_t block);
    void remember(estimator::ActiveSet& active, std::size_t block, const Known& known) const;
    /// Takes an orbit over as the last solution.
    void keep(Known& known, std::size_t block, FollowedOrbit orbit, const Eigen::VectorXd& place) const;
    /// A known place with another vector of the estimator.
    [[nodiscard]] static Eigen::VectorXd moved_place(const Known& known, const Eigen::VectorXd& theta);
    [[nodiscard]] const Following& following() const { return following_; }
    [[nodiscard]] bool in_domain(const Eigen::VectorXd& values) const;
    [[nodiscard]] FollowedOrbit solve(std::size_t block, const Known& known, const Eigen::VectorXd& place,
                                      bool derivatives) const;

    std::shared_ptr<const models::System> system_;
    estimator::ActiveSet initial_;

private:
    /// Vectors of the memory for each block; after them one with the number of anchorings.
    static constexpr std::size_t memory_parts = 10;

    Following following_;
    std::vector<models::ParameterBinding> bindings_;
};

}  // namespace orbid::periodic

#pragma GCC visibility pop
