#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "estimator/interface/residual.hpp"

namespace orbid::python {

class PythonResidual;

/// One computation of the estimator that may call residuals and functions written in Python, from any thread. Their
/// first exception is kept: it stops the computation and is raised at the caller.
class ResidualCall {
public:
    /// Call while holding the interpreter's lock. Reads groups and blocks of residuals written in Python.
    /// @throws TypeError for anything but residuals; ValueError for one given twice, or written in Python and used by
    ///         another running computation; what methods of a residual raise.
    explicit ResidualCall(const std::vector<pybind11::object>& residuals);
    /// Without residuals yet; they are added later, see add().
    ResidualCall() = default;
    ~ResidualCall();  ///< holding the lock
    ResidualCall(const ResidualCall&) = delete;
    ResidualCall& operator=(const ResidualCall&) = delete;

    [[nodiscard]] const std::vector<const estimator::Residual*>& residuals() const { return residuals_; }
    /// Adds a residual made meanwhile; call while holding the lock.
    void add(pybind11::handle residual);

    [[nodiscard]] bool failed() const { return failed_; }
    /// Keeps the first exception.
    void fail(std::exception_ptr exception);
    /// Calls Python holding the lock, unless something has failed before. @return whether that did not fail.
    template <class Call>
    bool attempt(const Call& call) {
        if (failed()) return false;
        const pybind11::gil_scoped_acquire lock;
        try {
            call();
            return true;
        } catch (...) {
            fail(std::current_exception());
            return false;
        }
    }

    /// Computes without the lock; `stopped` returns true after a signal or an exception.
    /// @return whether a signal requested a stop. @throws what was raised in Python; what `compute` throws.
    [[nodiscard]] bool compute(const std::function<void(const std::function<bool()>& stopped)>& compute);

private:
    void end();

    std::vector<pybind11::object> kept_;  ///< alive until the end
    std::vector<const estimator::Residual*> residuals_;
    std::vector<PythonResidual*> in_python_;  ///< of them
    std::atomic<bool> failed_ = false;
    std::mutex mutex_;
    std::exception_ptr exception_;
};

/// A residual whose methods are written in Python, as class Residual describes them there.
class PythonResidual final : public estimator::Residual {
public:
    /// Reads the object as it is now; from here to end() exceptions of methods go to `call`.
    /// @throws ValueError when it is used already; what is wrong with groups and blocks.
    void begin(ResidualCall& call);
    void end() { call_ = nullptr; }

    [[nodiscard]] std::string_view type() const override { return type_; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return structure_; }
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override { return covariances_; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

private:
    [[nodiscard]] pybind11::function method(const char* name) const;
    /// Groups, blocks, latent states and stage as the object has them now. Memory: which blocks it says are active.
    [[nodiscard]] estimator::ActiveSet read_set() const;
    void read_covariances();
    void read_structure();
    void read_values(const estimator::ActiveSet& active, pybind11::handle answer, Eigen::Index parameters,
                     bool derivatives, std::vector<estimator::BlockValue>& values) const;

    ResidualCall* call_ = nullptr;
    std::string type_ = "python";
    estimator::ActiveSet initial_;
    std::vector<estimator::JointCovariance> covariances_;
    estimator::LatentStructure structure_ = estimator::LatentStructure::none;
    mutable std::atomic<bool> evaluated_ = false;  ///< since begin(): later evaluations may fail, the first may not
};

/// Values of all blocks of a residual of the library, for method evaluate(); latents None: those of its start.
[[nodiscard]] pybind11::list evaluated(const estimator::Residual& residual, pybind11::handle theta,
                                       pybind11::handle latents, bool derivatives);

/// Values of one block from what evaluate() returned for it: a mapping with "e" and, if derivatives are requested,
/// "e_theta" and the block's other entries.
/// @throws TypeError, ValueError naming `where`, the entry and the shape needed.
[[nodiscard]] estimator::BlockValue block_value(pybind11::handle answer, const estimator::BlockLayout& block,
                                                Eigen::Index next_latents, Eigen::Index parameters, bool derivatives,
                                                const std::string& where);

/// A block from its description: "records" (and "group"), or "groups"; label, latents, and the other fields of
/// BlockLayout.
[[nodiscard]] estimator::BlockLayout block_layout(pybind11::handle description,
                                                  const std::vector<estimator::Group>& groups, std::size_t number);

}  // namespace orbid::python
