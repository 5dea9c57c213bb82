#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "estimator/interface/residual.hpp"

namespace orbid::python {

class PythonResidual;

/// One computation of the estimator that may call residuals and functions written in Python, from any thread. The first
/// exception that they raise is kept; the computation is stopped and the exception raised where it was called.
class ResidualCall {
public:
    /// Blocks that are suspended: put back, as an estimate begins; or left so, as what is asked of it later needs them.
    enum class Blocks { all, as_left };

    /// Call it holding the interpreter's lock. Reads groups and blocks of residuals that are written in Python.
    /// @throws TypeError for anything but residuals; ValueError for one that is given twice, or takes part in another
    ///         computation that still runs; what methods of a residual raise.
    ResidualCall(const std::vector<pybind11::object>& residuals, Blocks blocks);
    /// None yet: they are made meanwhile, see add().
    ResidualCall() = default;
    ~ResidualCall();  ///< holding the lock
    ResidualCall(const ResidualCall&) = delete;
    ResidualCall& operator=(const ResidualCall&) = delete;

    [[nodiscard]] const std::vector<estimator::Residual*>& residuals() const { return residuals_; }
    /// Further ones made meanwhile; holding the lock.
    void add(pybind11::handle residual);

    [[nodiscard]] bool failed() const { return failed_; }
    /// Keeps an exception, the first one.
    void fail(std::exception_ptr exception);

    /// Computes without the lock; `stopped` says yes after a signal and after an exception.
    /// @return whether a signal asked to stop. @throws what was raised in Python; what `compute` throws.
    [[nodiscard]] bool compute(const std::function<void(const std::function<bool()>& stopped)>& compute);

private:
    void end();

    Blocks blocks_ = Blocks::all;
    std::vector<pybind11::object> kept_;  ///< alive until the end
    std::vector<estimator::Residual*> residuals_;
    std::atomic<bool> failed_ = false;
    std::mutex mutex_;
    std::exception_ptr exception_;
};

/// A residual whose methods are written in Python, as class Residual describes them there.
class PythonResidual final : public estimator::Residual {
public:
    /// From here to end() exceptions of methods go to `call`. @throws what is wrong with groups and blocks.
    void begin(ResidualCall& call, ResidualCall::Blocks blocks);
    void end() { call_ = nullptr; }

    [[nodiscard]] std::string_view type() const override { return type_; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return structure_; }
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override { return covariances_; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return start_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) override;
    void deactivate(std::size_t block) override;
    [[nodiscard]] bool is_intermediate_stage() const override;

private:
    [[nodiscard]] pybind11::function method(const char* name) const;
    void read_groups();
    void read_layout();
    void read_values(pybind11::handle answer, Eigen::Index parameters, bool derivatives,
                     std::vector<estimator::BlockValue>& values) const;

    ResidualCall* call_ = nullptr;
    std::string type_ = "python";
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<estimator::JointCovariance> covariances_;
    std::vector<Eigen::VectorXd> start_;
    estimator::LatentStructure structure_ = estimator::LatentStructure::none;
    std::set<std::size_t> suspended_;
    mutable std::atomic<bool> evaluated_ = false;  ///< since begin(): later ones may fail, the first one may not
};

/// Values of all blocks of a residual of the library, at the latent states of its start where None: method evaluate().
[[nodiscard]] pybind11::list evaluated(estimator::Residual& residual, pybind11::handle theta, pybind11::handle latents,
                                       bool derivatives);

/// Values of one block from what evaluate() returned for it: a mapping with "e" and, where derivatives are asked for,
/// "e_theta" and what else the block has.
/// @throws TypeError, ValueError naming `where`, the entry and the shape needed.
[[nodiscard]] estimator::BlockValue block_value(pybind11::handle answer, const estimator::BlockLayout& block,
                                                Eigen::Index next_latents, Eigen::Index parameters, bool derivatives,
                                                const std::string& where);

/// A block from its description: "records" (and "group"), or "groups"; label, latents, and what BlockLayout has.
[[nodiscard]] estimator::BlockLayout block_layout(pybind11::handle description,
                                                  const std::vector<estimator::Group>& groups, std::size_t number);

}  // namespace orbid::python
