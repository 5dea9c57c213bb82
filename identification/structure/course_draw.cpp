#include "identification/structure/course_draw.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "identification/problem/estimated_values.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "models/arithmetic/splitmix64.hpp"
#include "orbits/observability/course_derivatives.hpp"
#include "orbits/simulation/node_state.hpp"

namespace orbid::identification {

namespace {

/// A prior that curves the posterior; a uniform one only bounds it.
bool informs(const estimator::Prior& prior) {
    return estimator::is_proper(prior) && !std::holds_alternative<estimator::UniformPrior>(prior);
}

/// Parameters of the estimate that are bound to the delay of an experiment's inputs.
std::vector<bool> delays(const IdentificationProblem& problem, const EstimateSetup& setup) {
    std::vector<bool> list(setup.parameters.size(), false);
    for (std::size_t e = 0; e < problem.experiments.size(); ++e) {
        const models::ParameterBinding& binding = setup.experiments[e];
        for (std::size_t j = 0; j < binding.parameter.size(); ++j)
            if (problem.experiments[e].delay == binding.parameter[j])
                list[static_cast<std::size_t>(binding.estimated[j])] = true;
    }
    return list;
}

}  // namespace

SharedUnknowns shared_unknowns(const IdentificationProblem& problem, const EstimateSetup& setup) {
    SharedUnknowns shared;
    const std::size_t count = setup.parameters.size();
    shared.column.assign(count, -1);
    shared.factor.assign(count, 1.0);
    std::vector<bool> of_the_model = delays(problem, setup);
    of_the_model.flip();
    for (const auto& experiment : setup.initial)
        for (const auto& coordinate : experiment)
            for (const Eigen::Index index : coordinate)
                of_the_model[static_cast<std::size_t>(index)] = false;
    for (std::size_t i = 0; i < count; ++i) {
        const estimator::FreeParameter& parameter = setup.parameters[i];
        if (!of_the_model[i] || !parameter.tied_to.empty()) continue;
        shared.column[i] = shared.size();
        shared.parameter.push_back(i);
        shared.known.push_back(informs(parameter.prior) || in_joint_prior(problem.joint_priors, parameter.name));
    }
    for (std::size_t i = 0; i < count; ++i) {
        if (!of_the_model[i] || setup.parameters[i].tied_to.empty()) continue;
        for (std::size_t k = 0; k < count; ++k)
            if (setup.parameters[k].name == setup.parameters[i].tied_to) shared.column[i] = shared.column[k];
        shared.factor[i] = setup.parameters[i].tie_factor;
    }
    return shared;
}

double generic_number(std::size_t draw, std::size_t index, std::size_t position) {
    const std::uint64_t bits = models::splitmix64((draw * 1000003 + index) * 1000003 + position);
    return (static_cast<double>(bits >> 12) + 0.5) * 0x1p-52;
}

CourseDraws::CourseDraws(const IdentificationProblem& problem, const EstimateSetup& setup, const SharedUnknowns& shared)
    : problem_(problem), setup_(setup), shared_(shared) {
    segments_.resize(problem.experiments.size());
    systems_.resize(problem.experiments.size());
    for (const std::size_t e : problem.series->data) {
        segments_[e] = problem.experiments[e].fitted_segments();
        systems_[e] = systems_with(problem.system, problem.experiments[e].inputs);
    }
}

Eigen::VectorXd CourseDraws::parameters(std::size_t draw) const {
    constexpr double spread = 0.1;
    Eigen::VectorXd theta = setup_.start();
    for (const std::size_t i : shared_.parameter) {
        const estimator::FreeParameter& parameter = setup_.parameters[i];
        double& value = theta[static_cast<Eigen::Index>(i)];
        const double size = value != 0.0 ? value : parameter.typical_size;
        const double by = spread * size * (2.0 * generic_number(draw, 0, i) - 1.0);
        // At a bound the other side is left; 0 may be special, as of a factor.
        for (const double moved : {value + by, value - by}) {
            if (!(moved > parameter.lower && moved < parameter.upper)) continue;
            value = moved;
            break;
        }
    }
    for (std::size_t i = 0; i < setup_.parameters.size(); ++i)
        if (!setup_.parameters[i].tied_to.empty() && shared_.column[i] >= 0) {
            const std::size_t leader = shared_.parameter[static_cast<std::size_t>(shared_.column[i])];
            theta[static_cast<Eigen::Index>(i)] = shared_.factor[i] * theta[static_cast<Eigen::Index>(leader)];
        }
    return theta;
}

std::size_t CourseDraws::courses(std::size_t experiment) const {
    // What inputs excite may happen anywhere in their record.
    constexpr std::size_t usual = 4, with_inputs = 40;
    const bool anywhere = !problem_.experiments[experiment].inputs.empty() ||
                          !problem_.system->smooth(setup_.experiments[experiment].values(setup_.start()));
    const std::size_t most = anywhere ? with_inputs : usual;
    return std::max(most, std::min<std::size_t>(segments_[experiment].size(), with_inputs));
}

CourseDraws::Place CourseDraws::place(std::size_t experiment, std::size_t index, std::size_t draw) const {
    const auto& segments = segments_[experiment];
    const std::size_t segment = segments[index % segments.size()];
    if (index < segments.size()) return {segment, 0};
    // Somewhere in the first nine tenths: a course needs room.
    constexpr double room = 0.9;
    const auto samples = static_cast<double>(problem_.experiments[experiment].series->segments[segment].times.size());
    return {segment, static_cast<Eigen::Index>(room * samples * generic_number(draw, index, 1000))};
}

const models::System& CourseDraws::system(std::size_t experiment, std::size_t index) const {
    const auto& systems = systems_[experiment];
    return systems.size() == 1 ? *systems.front() : *systems[place(experiment, index, 0).segment];
}

/// @param unread  size of what is neither read nor given
Eigen::VectorXd CourseDraws::state_at(std::size_t experiment, const Place& place, std::size_t draw,
                                      const Eigen::VectorXd& theta, double unread) const {
    constexpr double small = 1e-3;
    const Experiment& data = problem_.experiments[experiment];
    const std::vector<Eigen::Index> samples{place.sample};
    const auto& systems = systems_[experiment];
    const models::System& system = systems.size() == 1 ? *systems.front() : *systems[place.segment];
    Eigen::VectorXd state =
        orbits::node_states(system, theta, *data.series, place.segment, data.sensor, samples).col(0);
    for (Eigen::Index i = 0; i < state.size(); ++i) {
        const std::size_t index = static_cast<std::size_t>(i);
        const InitialValue initial = index < data.initial_state.size() ? data.initial_state[index] : InitialValue{};
        if (!initial.estimate && place.sample == 0 && !problem_.series->interval) {
            state[i] = initial.value.value_or(0.0);
            continue;
        }
        const bool read = std::find(data.observe.begin(), data.observe.end(), i) != data.observe.end() &&
                          models::reading_function(data.sensor, index) == nullptr;
        const double generic = generic_number(draw, index + 1, static_cast<std::size_t>(place.sample));
        if (read && std::isfinite(state[i])) {
            // A reading of exactly 0 is special too.
            state[i] = state[i] != 0.0 ? state[i] * (1.0 + small * (2.0 * generic - 1.0)) : small * unread * generic;
            continue;
        }
        double centre = initial.value.value_or(std::isfinite(state[i]) ? state[i] : 0.0);
        // A coordinate at 0 is special: symmetries and products hide there.
        state[i] = std::abs(centre) > 1e-3 * unread ? centre * (0.8 + 0.4 * generic) : unread * (0.5 + 0.5 * generic);
    }
    return state;
}

CourseInformation CourseDraws::course(std::size_t experiment, std::size_t index, std::size_t draw) const {
    const Experiment& data = problem_.experiments[experiment];
    const models::ParameterBinding& binding = setup_.experiments[experiment];
    const Eigen::VectorXd theta = binding.values(parameters(draw));
    const Place at = place(experiment, index, draw);
    const orbits::Segment& segment = data.series->segments[at.segment];
    CourseInformation information;
    information.experiment = experiment;
    information.index = index;
    information.draw = draw;
    const Eigen::Index last = segment.times.size() - 1;
    if (last <= at.sample) return information;
    const double delay = data.delay ? theta[*data.delay] : 0.0;
    information.phase = orbits::phase_at(*problem_.system, theta, *data.series, segment, at.sample) - delay;
    orbits::CourseDerivatives derivatives;
    // A state far off what the model does can leave the range of numbers at once.
    for (const double unread : {1.0, 0.1, 0.01}) {
        information.state = state_at(experiment, at, draw, theta, unread);
        derivatives =
            orbits::course_derivatives({system(experiment, index), data.sensor, data.observe, information.state,
                                        information.phase, segment.times[last] - segment.times[at.sample]},
                                       theta, binding.parameter);
        if (derivatives.by_state.rows() > 0) break;
    }
    const Eigen::Index rows = derivatives.by_state.rows();
    if (rows == 0) return information;
    const bool fixed_values = at.sample == 0 && !problem_.series->interval;
    for (Eigen::Index i = 0; i < information.state.size(); ++i) {
        const std::size_t coordinate = static_cast<std::size_t>(i);
        const bool given = coordinate < data.initial_state.size();
        const InitialValue initial = given ? data.initial_state[coordinate] : InitialValue{};
        const bool known = initial.estimate ? at.sample == 0 && informs(initial.prior) : fixed_values;
        if (!known) information.own.push_back(i);
    }
    information.by_own = derivatives.by_state(Eigen::all, information.own);
    information.own_terms = derivatives.state_terms(Eigen::all, information.own);
    information.by_shared = Eigen::MatrixXd::Zero(rows, shared_.size());
    information.shared_terms = information.by_shared;
    for (std::size_t j = 0; j < binding.parameter.size(); ++j) {
        const auto estimated = static_cast<std::size_t>(binding.estimated[j]);
        const Eigen::Index column = shared_.column[estimated];
        if (column < 0) continue;
        const double factor = shared_.factor[estimated];
        const auto from = static_cast<Eigen::Index>(j);
        information.by_shared.col(column) += factor * derivatives.by_parameters.col(from);
        information.shared_terms.col(column) += std::abs(factor) * derivatives.parameter_terms.col(from);
    }
    const std::size_t observed = data.observe.size();
    for (std::size_t r = 0; r < observed; ++r) {
        double terms = 0.0;
        for (Eigen::Index k = static_cast<Eigen::Index>(r); k < rows; k += static_cast<Eigen::Index>(observed))
            terms += derivatives.state_terms.row(k).sum() + information.shared_terms.row(k).sum();
        information.silent.push_back(!(terms > 0.0));
    }
    return information;
}

}  // namespace orbid::identification
