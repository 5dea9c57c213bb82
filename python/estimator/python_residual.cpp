#include "python/estimator/python_residual.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/estimator/error_model.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

py::list latent_list(const std::vector<Eigen::VectorXd>& latents) {
    return listed(latents, [](const Eigen::VectorXd& one) { return array(Eigen::VectorXd(one)); });
}

/// The first entry of a block that is not finite, with its value; empty: all are.
std::string first_not_finite(const estimator::BlockValue& value) {
    const std::pair<const char*, Eigen::Ref<const Eigen::MatrixXd>> parts[] = {
        {"e", value.e}, {"e_theta", value.e_theta}, {"e_z", value.e_z}, {"e_next", value.e_next},
        {"c", value.c}, {"c_theta", value.c_theta}, {"c_z", value.c_z}, {"c_next", value.c_next}};
    for (const auto& [name, values] : parts) {
        if (values.allFinite()) continue;
        for (Eigen::Index i = 0; i < values.rows(); ++i)
            for (Eigen::Index j = 0; j < values.cols(); ++j)
                if (!std::isfinite(values(i, j)))
                    return std::string(name) + "[" + std::to_string(i) +
                           (values.cols() > 1 ? ", " + std::to_string(j) : "") + "] = " + std::to_string(values(i, j));
    }
    return {};
}

}  // namespace

ResidualCall::ResidualCall(const std::vector<py::object>& residuals) {
    if (residuals.empty()) throw py::value_error("residuals: there is none");
    try {
        for (const py::object& residual : residuals)
            add(residual);
    } catch (...) {
        end();
        throw;
    }
}

ResidualCall::~ResidualCall() {
    end();
}

void ResidualCall::end() {
    for (PythonResidual* residual : in_python_)
        residual->end();
    in_python_.clear();
    residuals_.clear();
}

void ResidualCall::add(py::handle residual) {
    if (residual.is_none() || !py::isinstance<estimator::Residual>(residual))
        throw py::type_error("residuals: " + std::string(py::repr(residual)) + " is no Residual");
    auto* one = residual.cast<estimator::Residual*>();
    if (std::find(residuals_.begin(), residuals_.end(), one) != residuals_.end())
        throw py::value_error("residuals: the same residual is given twice");
    if (auto* python = dynamic_cast<PythonResidual*>(one)) {
        python->begin(*this);
        in_python_.push_back(python);
    }
    kept_.push_back(py::reinterpret_borrow<py::object>(residual));
    residuals_.push_back(one);
}

void ResidualCall::fail(std::exception_ptr exception) {
    const std::lock_guard lock(mutex_);
    if (!exception_) exception_ = std::move(exception);
    failed_ = true;
}

bool ResidualCall::compute(const std::function<void(const std::function<bool()>& stopped)>& compute) {
    bool interrupted = false;
    try {
        interrupted = computed_until_interrupted(
            [&](const std::function<bool()>& stopped) { compute([this, &stopped] { return failed() || stopped(); }); });
    } catch (...) {
        // What was raised in Python is the cause of whatever came after it.
        if (exception_) std::rethrow_exception(std::exchange(exception_, nullptr));
        throw;
    }
    if (exception_) std::rethrow_exception(std::exchange(exception_, nullptr));
    return interrupted;
}

py::function PythonResidual::method(const char* name) const {
    return py::get_override(static_cast<const estimator::Residual*>(this), name);
}

void PythonResidual::begin(ResidualCall& call) {
    if (call_ != nullptr) throw py::value_error("residuals: one takes part in another computation that still runs");
    if (!method("evaluate")) throw py::type_error("a Residual needs a method evaluate(theta, latents, derivatives)");
    if (!method("groups") || !method("layout"))
        throw py::type_error("a Residual needs methods groups() and layout(), besides evaluate()");
    if (const py::function type = method("type")) type_ = py::str(type());
    initial_ = read_set();
    read_covariances();
    read_structure();
    evaluated_ = false;
    call_ = &call;
}

estimator::ActiveSet PythonResidual::read_set() const {
    estimator::ActiveSet set;
    for (const py::handle description : method("groups")())
        set.groups.push_back(group(description, set.groups.size()));
    for (const py::handle description : method("layout")())
        set.layout.edit().push_back(block_layout(description, set.groups, set.layout.size()));
    if (set.layout.empty()) throw py::value_error("layout(): there is no block");
    const py::function latents = method("initial_latents");
    const py::list given = latents ? py::list(latents()) : py::list();
    if (latents && given.size() != set.layout.size())
        throw py::value_error("initial_latents(): " + std::to_string(given.size()) +
                              " vectors, needs one for each of " + std::to_string(set.layout.size()) + " blocks");
    Eigen::VectorXd& active = set.memory.emplace_back(std::ssize(set.layout));
    for (std::size_t b = 0; b < set.layout.size(); ++b) {
        const estimator::BlockLayout& block = set.layout[b];
        const std::string where = "initial_latents()[" + std::to_string(b) + "]";
        set.latents.push_back(latents ? Eigen::VectorXd(vector(finite_vector(given[b], where.c_str(), block.latents)))
                                      : Eigen::VectorXd::Zero(block.latents));
        active[static_cast<Eigen::Index>(b)] = block.active ? 1.0 : 0.0;
    }
    const py::function stage = method("is_intermediate_stage");
    set.is_intermediate_stage = stage && stage().cast<bool>();
    return set;
}

void PythonResidual::read_covariances() {
    covariances_.clear();
    const py::function covariances = method("covariances");
    if (!covariances) return;
    for (const py::handle description : covariances()) {
        NamedArguments given("covariance", description);
        estimator::JointCovariance covariance;
        for (const std::string& name : given.texts("groups")) {
            const auto found = std::find_if(groups().begin(), groups().end(),
                                            [&](const estimator::Group& one) { return one.name == name; });
            if (found == groups().end()) throw py::value_error("covariance: there is no group '" + name + "'");
            covariance.groups.push_back(static_cast<int>(found - groups().begin()));
        }
        given.take({{"dof", covariance.dof}, {"psi", covariance.psi}});
        given.finish();
        covariances_.push_back(std::move(covariance));
    }
}

void PythonResidual::read_structure() {
    const auto has_latents = [](const estimator::BlockLayout& block) { return block.latents > 0; };
    structure_ = std::any_of(layout().begin(), layout().end(), has_latents)
                     ? estimator::LatentStructure::independent_blocks
                     : estimator::LatentStructure::none;
    const py::function structure = method("structure");
    if (!structure) return;
    py::dict answer;
    answer["structure"] = structure();
    constexpr estimator::LatentStructure kinds[] = {
        estimator::LatentStructure::none, estimator::LatentStructure::independent_blocks,
        estimator::LatentStructure::chain, estimator::LatentStructure::cyclic_chain};
    structure_ = kinds[NamedArguments("structure()", answer)
                           .choice("structure", {"none", "independent_blocks", "chain", "cyclic_chain"})];
}

std::vector<estimator::BlockValue> PythonResidual::evaluate(const estimator::ActiveSet& active,
                                                            const Eigen::VectorXd& theta,
                                                            const std::vector<Eigen::VectorXd>& latents,
                                                            bool derivatives) const {
    std::vector<estimator::BlockValue> values(active.layout.size());
    const bool answered = call_ != nullptr && call_->attempt([&] {
        read_values(active, method("evaluate")(array(Eigen::VectorXd(theta)), latent_list(latents), derivatives),
                    theta.size(), derivatives, values);
        evaluated_ = true;
    });
    for (std::size_t b = 0; b < active.layout.size() && !answered; ++b)
        if (active.layout[b].active) values[b].status = estimator::BlockStatus::failed;
    return values;
}

void PythonResidual::read_values(const estimator::ActiveSet& active, py::handle answer, Eigen::Index parameters,
                                 bool derivatives, std::vector<estimator::BlockValue>& values) const {
    py::object blocks = py::reinterpret_borrow<py::object>(answer);
    if (py::isinstance<py::dict>(blocks)) {
        py::list only;
        only.append(blocks);
        blocks = only;
    }
    if (!is_list(blocks) || py::isinstance<py::array>(blocks))
        throw py::type_error("evaluate() returned " +
                             std::string(py::str(py::type::handle_of(blocks).attr("__name__"))) +
                             ", needs a list with a dict for each block");
    if (py::len(blocks) != values.size())
        throw py::value_error("evaluate() returned " + std::to_string(py::len(blocks)) + " blocks, layout() has " +
                              std::to_string(values.size()));
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (!active.layout[b].active) continue;
        const py::object block = blocks[py::int_(b)];
        const std::string where = "evaluate(), block " + std::to_string(b);
        if (block.is_none()) {
            values[b].status = estimator::BlockStatus::failed;
            continue;
        }
        const Eigen::Index next = active.layout[b].next >= 0
                                      ? active.layout.all().at(static_cast<std::size_t>(active.layout[b].next)).latents
                                      : 0;
        values[b] = block_value(block, active.layout[b], next, parameters, derivatives, where);
        const std::string what = first_not_finite(values[b]);
        if (what.empty()) continue;
        if (!evaluated_)
            throw py::value_error(where + ": " + what +
                                  " at the start; return None for a block that cannot be evaluated");
        values[b] = {};
        values[b].status = estimator::BlockStatus::failed;
    }
}

estimator::RefreshReport PythonResidual::update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                                           const std::vector<Eigen::VectorXd>& latents,
                                                           const Eigen::VectorXd& scales) const {
    estimator::RefreshReport report;
    const auto ask = [&] {
        const py::function update = method("update_active_set");
        if (!update) return;
        const py::object answer =
            update(array(Eigen::VectorXd(theta)), latent_list(latents), array(Eigen::VectorXd(scales)));
        if (answer.is_none()) return;
        NamedArguments given("update_active_set()", answer);
        given.take({{"changed", report.changed},
                    {"lost", report.lost},
                    {"rejected", report.rejected},
                    {"added", report.added}});
        given.finish();
        estimator::ActiveSet next = read_set();
        // What the estimator took out stays out.
        const Eigen::VectorXd& told = active.memory.front();
        for (std::size_t b = 0; b < active.layout.size() && active.layout.size() == next.layout.size(); ++b)
            if (!active.layout[b].active && told[static_cast<Eigen::Index>(b)] != 0.0)
                next.layout.edit()[b].active = false;
        active = std::move(next);
    };
    if (call_ != nullptr) call_->attempt(ask);
    return report;
}

}  // namespace orbid::python
