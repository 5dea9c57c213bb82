#include "estimator/minimum.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "estimator/error_limits.hpp"
#include "estimator/plain_least_squares.hpp"
#include "estimator/trust_region.hpp"

namespace orbid::estimator {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// After the convergence test is met, steps go on while they gain digits: at most this many, and not below this length
/// in posterior sds, where nothing that is ever shown changes.
constexpr int polishing_steps = 12;
constexpr double polished = 1e-10;

/// Steps are stretched by what the last one taught only this close to the minimum, in posterior sds.
constexpr double near_sds = 1.0;

/// Steps shorter than this, in posterior sds, are judged by gradients. Computed orbits carry rounding of up to 1e-6 sds
/// of their targets, which hides the 5e-7 that a step of 1e-3 gains and is a fiftieth of the 5e-5 of a step of 1e-2.
constexpr double tiny_sds = 1e-2;

/// Steps below this many of the least changes that a residual can show (see error_limits()) are rounding; where the
/// scale is held at its floor these are its sds.
constexpr double floor_sds = 100.0;

/// Violations of constraints fall by this factor from stage to stage, down to a share of their sizes that changes no
/// estimate: what data with errors of a ten-thousandth say is still 1e5 times looser.
constexpr double tightening = 0.1;
constexpr double exact_matching = 1e-9;

/// Stages of loose constraints settle within a dozen steps, or parameters run along a valley to infinity. Then the
/// minimisation begins again with parameters kept within their own size of the start until violations are this small.
constexpr int stage_limit = 20;
constexpr double tight_matching = 1e-3;

/// A provisional round ends with the first accepted step that lowers the sum of squares by less than this share, or
/// after so many: what a loose stage leaves undone the next one does as well (the pendulum's section series, matching
/// lowered tenfold whenever a step gained less than 30 %: 13 to 22 steps in all from bad starts).
constexpr double provisional_gain = 0.3;
constexpr int provisional_steps = 5;

std::string figures(const char* format, double value) {
    char text[96];
    std::snprintf(text, sizeof text, format, value);
    return text;
}

/// One minimisation: the state and everything derived from it at the present point.
class Minimisation {
public:
    /// @param limited  parameters keep within their own size of the start until the constraints are tight
    Minimisation(const Problem& problem, const BlockSet& set, State& state, Ledger& ledger, bool limited)
        : problem_(problem),
          set_(set),
          state_(state),
          ledger_(ledger),
          failures_(set.blocks.size(), 0),
          cut_(set.blocks.size(), false),
          limited_(limited),
          lower_(problem.lower),
          upper_(problem.upper) {
        if (!limited) return;
        const Eigen::VectorXd size = sizes(problem, state.theta);
        lower_ = lower_.cwiseMax(state.u - size);
        upper_ = upper_.cwiseMin(state.u + size);
    }

    Minimum run();
    /// Whether run() gave up in a stage of loose constraints that did not settle.
    [[nodiscard]] bool unsettled() const { return !limited_ && stage_trials_ > stage_limit; }

private:
    bool start();
    bool update_errors(bool profile);
    [[nodiscard]] ErrorLimits limits() const {
        return error_limits(problem_, set_, state_, minimum_.rows, latent_fit_);
    }
    template <class Change>
    void rescale(Change change);
    bool tighten(bool at_once);
    bool without_covariance();
    [[nodiscard]] double initial_radius() const;
    void build_model();
    bool try_step(const TrialStep& step);
    template <class Rule>
    bool stopped_blocks(Rule rule);
    [[nodiscard]] double objective() const;
    /// Half the sum of squares of standard errors and constraints.
    /// Starts of stages on the way lie far out: steps then are never longer than what far records bear.
    [[nodiscard]] Curvature curvature() const { return set_.provisional ? Curvature::guarded : Curvature::step; }
    [[nodiscard]] double misfit() const {
        double square = 0.0;
        for (const BlockTriangle& block : arrow_.blocks) {
            square += block.triangle.rightCols(1).squaredNorm();
            if (block.link.size() > 0) square += block.link.rightCols(1).squaredNorm();
        }
        return 0.5 * square;
    }
    [[nodiscard]] bool any_error_estimated() const {
        const std::vector<bool> free = free_errors(problem_, set_);
        return std::find(free.begin(), free.end(), true) != free.end();
    }

    const Problem& problem_;
    const BlockSet& set_;
    State& state_;
    Ledger& ledger_;
    Minimum minimum_;
    Arrow arrow_;
    double value_ = 0.0;  ///< -ln p of the errors at the state, without ln|Sigma|
    StepModel model_;
    std::vector<int> failures_;  ///< steps in a row that had to be shortened because of each block
    std::vector<bool> cut_;      ///< blocks that failed at a trial of the present step
    bool limited_;
    Eigen::VectorXd lower_;  ///< of u, move limits included
    Eigen::VectorXd upper_;
    int accepted_ = 0;
    int stage_trials_ = 0;  ///< in the present stage of loose constraints
    double stretch_ = 1.0;  ///< length of the best step over the full Gauss-Newton step, from the last full step
    double radius_ = 0.0;
    Eigen::VectorXd latent_fit_;  ///< see latent_fit_sizes(), at the start
    double rounding_ = 0.0;  ///< least change that residuals can show, in sds of the errors: the largest of all scales
    bool derivatives_at_trial_ = true;
    double last_decrease_ = 0.0;   ///< of the last accepted step
    double last_objective_ = 0.0;  ///< sum of squares before it, for the stages of constraints
    double gain_ = 0.0;            ///< actual over predicted decrease of the last step
    bool last_step_full_ = false;
};

bool Minimisation::start() {
    if (is_plain_least_squares(problem_, set_)) {
        minimum_.evaluation = solve_plain_least_squares(problem_, set_, state_, ledger_);
    } else {
        minimum_.evaluation = evaluate(problem_.residuals, set_, problem_.laws, state_.theta, state_.latents, true);
        ++ledger_.evaluations;
    }
    if (!minimum_.evaluation.failed.empty()) {
        minimum_.stopped = minimum_.evaluation.failed;
        minimum_.outcome = Outcome::start_failed;
        return false;
    }
    minimum_.rows = linearise(set_, problem_.laws, minimum_.evaluation.values, problem_.coordinates, state_.theta);
    minimum_.prior = prior_at(problem_, state_.u);
    minimum_.error_at_floor.assign(problem_.errors.size(), false);
    minimum_.error_at_ceiling = minimum_.error_at_floor;
    // The first constraints are as loose as they are violated.
    minimum_.matching = std::clamp(violation(set_, minimum_.evaluation.values).rms, exact_matching, 1e6);
    latent_fit_ = latent_fit_sizes(problem_, set_, state_, minimum_.rows, minimum_.matching);
    if (!state_.errors_known) {
        const ErrorLimits limit = limits();
        for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
            const ErrorCoordinate& coordinate = problem_.errors[k];
            const auto i = static_cast<Eigen::Index>(k);
            if (coordinate.kind == ErrorCoordinate::Kind::log && !(coordinate.start > 0.0))
                state_.psi[i] = std::max({limit.size[i], limit.floor[i], latent_fit_[i]});
        }
        // What a stage on the way makes of them is no start for the estimate proper.
        state_.errors_known = !set_.provisional;
    }
    return true;
}

double Minimisation::objective() const {
    double value = value_ + 0.5 * set_.ln_det_shapes + minimum_.prior.value;
    const double weight = 1.0 / (minimum_.matching * minimum_.matching);
    for (const BlockRows& block : minimum_.rows)
        if (block.link.size() > 0) value += 0.5 * weight * block.link.rightCols(1).squaredNorm();
    return value;
}

void Minimisation::build_model() {
    StandardArrow standard =
        standard_arrow(minimum_.rows, problem_.laws, state_.psi, minimum_.matching, curvature());
    arrow_ = std::move(standard.arrow);
    value_ = standard.value;
    const Eigen::VectorXd fallback = sizes(problem_, state_.theta);
    const Condensed condensed = condense(arrow_, 0.0);
    Eigen::VectorXd norm = condensed.r.colwise().norm().transpose();
    for (Eigen::Index i = 0; i < norm.size(); ++i)
        if (!(norm[i] > 0.0)) norm[i] = 1.0 / fallback[i];
    model_.damping = model_.damping.size() == norm.size() ? Eigen::VectorXd(model_.damping.cwiseMax(norm)) : norm;
    model_.arrow = &arrow_;
    model_.prior = &minimum_.prior;
    model_.bounds = {lower_ - state_.u, upper_ - state_.u};
    model_.fallback = fallback;
    model_.rank_tolerance = problem_.options.relative_singular_value;
    minimum_.step = step_at(model_, 0.0).parameters;
}

bool Minimisation::update_errors(bool profile) {
    build_model();
    if (!any_error_estimated()) return true;
    Eigen::Index dead = 0;
    for (const BlockTriangle& block : arrow_.blocks)
        dead += std::count(block.dead.begin(), block.dead.end(), true);
    const Eigen::Index taken = set_.latents - dead - set_.constraints + minimum_.step.space.data.cols();
    if (set_.records <= taken) {
        minimum_.outcome = Outcome::no_freedom;
        minimum_.message = std::to_string(set_.records) + " records cannot determine " + std::to_string(taken) +
                           " parameters and latent states and an error scale as well";
        return false;
    }
    if (without_covariance()) return false;
    for (std::size_t i = 0; i < minimum_.step.active.size(); ++i)
        if (minimum_.step.active[i] != 0 && minimum_.step.d[static_cast<Eigen::Index>(i)] != 0.0) profile = false;
    const ErrorProblem errors = error_problem(problem_, set_, minimum_, profile ? Follow::all : Follow::latents);
    const ErrorLimits limit = limits();
    rounding_ = limit.rounding;
    const ErrorMinimum found = minimise_errors(errors, state_.psi, limit.floor, limit.ceiling);
    if (found.steps > 0)
        ledger_.history.push_back(
            {ledger_.round, "scales", true, found.before, found.after, 0.0, "", set_.provisional});
    minimum_.error_at_floor = found.at_floor;
    minimum_.error_at_ceiling = found.at_ceiling;
    const Eigen::VectorXd psi =
        problem_.options.variance == Variance::integrated ? integrated_scales(errors, found) : found.psi;
    rescale([&] { state_.psi = psi; });
    return !without_covariance();
}

/// Whether a full covariance cannot be estimated; the outcome then says why.
bool Minimisation::without_covariance() {
    const std::string reason = why_no_covariance(problem_, set_, state_.psi, minimum_.step.space.data.cols());
    if (reason.empty()) return false;
    minimum_.outcome = Outcome::no_freedom;
    minimum_.message = reason;
    return true;
}

/// Damping and radius are kept in units of the standardised problem, which `change` changes.
template <class Change>
void Minimisation::rescale(Change change) {
    const Eigen::VectorXd before = condense(arrow_, 0.0).r.colwise().norm();
    change();
    arrow_ = standard_arrow(minimum_.rows, problem_.laws, state_.psi, minimum_.matching, curvature()).arrow;
    const Eigen::VectorXd after = condense(arrow_, 0.0).r.colwise().norm();
    double old_size = 0.0;
    double new_size = 0.0;
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    for (Eigen::Index i = 0; i < before.size(); ++i) {
        if (!(before[i] > 0.0) || !(after[i] > 0.0)) continue;
        old_size = std::hypot(old_size, model_.damping[i] * size[i]);
        model_.damping[i] *= after[i] / before[i];
        new_size = std::hypot(new_size, model_.damping[i] * size[i]);
    }
    if (old_size > 0.0) radius_ *= new_size / old_size;
    build_model();
}

/// The next stage of the constraints, when this one has little left to give (or `at_once`).
/// @return whether there was one
bool Minimisation::tighten(bool at_once) {
    if (set_.constraints == 0 || !(minimum_.matching > exact_matching)) return false;
    // Short steps say nothing about how much this stage has left.
    if (!at_once && (!last_step_full_ || !(last_decrease_ < 0.05 * last_objective_))) return false;
    rescale([this] { minimum_.matching = std::max(exact_matching, tightening * minimum_.matching); });
    stage_trials_ = 0;
    if (minimum_.matching < tight_matching) {
        lower_ = problem_.lower;
        upper_ = problem_.upper;
    }
    build_model();
    radius_ = std::max(radius_, initial_radius());
    return true;
}

/// The first step may change every parameter by about its own size (a factor e in log coordinates); latent states have
/// no say: with many of them a parameter could go anywhere. Without parameters they do the same.
double Minimisation::initial_radius() const {
    if (model_.damping.size() > 0) return model_.damping.cwiseProduct(sizes(problem_, state_.theta)).norm();
    double radius = 0.0;
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        const Eigen::VectorXd& norm = arrow_.blocks[b].norm;
        const Eigen::VectorXd& z = state_.latents[set_.blocks[b].residual][set_.blocks[b].block];
        radius =
            std::hypot(radius, norm.cwiseProduct(z.cwiseAbs().cwiseMax(Eigen::VectorXd::Ones(norm.size()))).norm());
    }
    return radius;
}

/// Names the blocks that the rule holds for as stopped, unless that were half of a residual's blocks or more: then it
/// is not they that stand apart, and shorter steps have to do.
template <class Rule>
bool Minimisation::stopped_blocks(Rule rule) {
    std::vector<std::size_t> active(problem_.residuals.size(), 0);
    std::vector<std::size_t> lost(problem_.residuals.size(), 0);
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        ++active[set_.blocks[b].residual];
        if (!rule(b)) continue;
        ++lost[set_.blocks[b].residual];
        minimum_.stopped.push_back(b);
    }
    for (std::size_t r = 0; r < active.size(); ++r)
        if (lost[r] > 0 && 2 * lost[r] >= active[r]) minimum_.stopped.clear();
    if (minimum_.stopped.empty()) return false;
    minimum_.outcome = Outcome::blocks_stopped;
    return true;
}

bool Minimisation::try_step(const TrialStep& step) {
    State trial = state_;
    for (Eigen::Index i = 0; i < trial.u.size(); ++i) {
        const auto index = static_cast<std::size_t>(i);
        trial.u[i] = std::clamp(state_.u[i] + step.parameters.d[i], lower_[i], upper_[i]);
        if (step.parameters.active[index] < 0) trial.u[i] = lower_[i];
        if (step.parameters.active[index] > 0) trial.u[i] = upper_[i];
        trial.theta[i] = std::clamp(problem_.coordinates[index].natural(trial.u[i]), problem_.parameters[index].lower,
                                    problem_.parameters[index].upper);
    }
    for (std::size_t b = 0; b < set_.blocks.size(); ++b)
        trial.latents[set_.blocks[b].residual][set_.blocks[b].block] += step.latents[b];

    ++ledger_.trials;
    const double before = objective();
    StepRecord record{ledger_.round, "theta", false, before, before, step.mu, "", set_.provisional};
    const PriorModel prior = prior_at(problem_, trial.u);
    double alpha = 0.25;  // share of the step to keep after a rejection
    double change = infinity;
    double true_curvature = -1.0;
    Evaluation evaluation;
    std::vector<BlockRows> rows;
    if (std::isfinite(prior.value)) {
        evaluation =
            evaluate(problem_.residuals, set_, problem_.laws, trial.theta, trial.latents, derivatives_at_trial_);
        ++ledger_.evaluations;
        if (!evaluation.failed.empty()) {
            for (const std::size_t b : evaluation.failed)
                cut_[b] = true;
            record.reason = "block failed";
        } else {
            change = prior.value - minimum_.prior.value;
            change += value_change(set_, problem_.laws, state_.psi, minimum_.evaluation.values, evaluation.values);
            if (set_.constraints > 0)
                change += violation_change(set_, minimum_.evaluation.values, evaluation.values) /
                          (minimum_.matching * minimum_.matching);
            record.after = before + change;
            true_curvature = 2.0 * (change - step.slope);
            // Tiny steps: the gradients at both ends keep what the difference of two objectives loses to rounding.
            if (derivatives_at_trial_ && step.curvature < tiny_sds * tiny_sds) {
                rows = linearise(set_, problem_.laws, evaluation.values, problem_.coordinates, trial.theta);
                const Arrow arrow =
                    standard_arrow(rows, problem_.laws, state_.psi, minimum_.matching, curvature()).arrow;
                const double slope =
                    model_change(arrow, step.parameters.d, step.latents).linear + prior.gradient.dot(step.parameters.d);
                change = 0.5 * (step.slope + slope);
                true_curvature = slope - step.slope;
                record.after = before + std::min(change, 0.0);
            }
            // Step length of the parabola through both values and the first slope.
            if (change > 0.0) alpha = std::clamp(-0.5 * step.slope / (change - step.slope), 0.1, 0.5);
        }
    }
    const double predicted = step.predicted_decrease();
    gain_ = predicted > 0.0 ? -change / predicted : -infinity;
    // A ten-thousandth of what was promised is the usual least gain that still proves convergence.
    if (change < 0.0 && gain_ > 1e-4) {
        record.accepted = true;
        if (!derivatives_at_trial_) {
            evaluation = evaluate(problem_.residuals, set_, problem_.laws, trial.theta, trial.latents, true);
            ++ledger_.evaluations;
            if (!evaluation.failed.empty()) {
                record.accepted = false;
                record.reason = "block failed";
            }
        }
    } else if (record.reason.empty()) {
        record.reason = "no decrease";
    }
    if (!record.accepted) {
        record.after = before;
        ledger_.history.push_back(record);
        radius_ = alpha * std::min(radius_, step.length);
        derivatives_at_trial_ = false;
        return false;
    }
    // Close to the minimum steps of Gauss-Newton keep their direction and are too long or too short by the same factor
    // each time (Hartley's interpolation, carried over to the next step).
    stretch_ = last_step_full_ && gain_ > 0.3 && true_curvature > 0.0
                   ? std::clamp(step.curvature / true_curvature, 0.4, 2.5)
                   : 1.0;
    ledger_.history.push_back(record);
    ++ledger_.iterations;
    last_objective_ = misfit();
    last_decrease_ = -change;
    ++accepted_;
    state_ = std::move(trial);
    if (rows.empty()) rows = linearise(set_, problem_.laws, evaluation.values, problem_.coordinates, state_.theta);
    minimum_.evaluation = std::move(evaluation);
    minimum_.rows = std::move(rows);
    minimum_.prior = prior;
    derivatives_at_trial_ = true;
    if (gain_ < 0.25)
        radius_ = 0.5 * std::min(radius_, step.length);
    else if (gain_ > 0.75)
        radius_ = std::max(radius_, 2.5 * step.length);
    if (problem_.options.progress) problem_.options.progress(ledger_.iterations, record.after);
    return true;
}

Minimum Minimisation::run() {
    if (!start()) return std::move(minimum_);
    if (!update_errors(false)) return std::move(minimum_);
    radius_ = initial_radius();
    int rejected = 0;
    int polish = 0;
    double last_remaining = infinity;
    while (true) {
        TrialStep full = step_at(model_, 0.0);
        minimum_.step = full.parameters;
        minimum_.remaining = std::sqrt(std::max(full.curvature, 0.0));
        const bool met = minimum_.remaining < problem_.options.step_tolerance;
        if (met && tighten(true)) {
            rejected = 0;
            continue;
        }
        if (met && (minimum_.remaining < polished || polish >= polishing_steps || rejected > 0 ||
                    (polish > 1 && minimum_.remaining > 0.8 * last_remaining))) {
            minimum_.outcome = Outcome::converged;
            minimum_.message = "the full step that is left is " + figures("%.2g", minimum_.remaining) +
                               " posterior sds, below " + figures("%.2g", problem_.options.step_tolerance);
            break;
        }
        if (problem_.options.interrupted && problem_.options.interrupted()) {
            minimum_.outcome = Outcome::interrupted;
            minimum_.message = "interrupted after " + std::to_string(ledger_.iterations) + " steps";
            break;
        }
        // Nothing below rounding can be gained by shorter steps still.
        const bool hopeless = rejected >= 30 || radius_ < 1e-14 * model_.damping.cwiseProduct(model_.fallback).norm();
        // With a scale at its floor a sd is itself the rounding of the residuals.
        const bool at_floor = std::any_of(minimum_.error_at_floor.begin(), minimum_.error_at_floor.end(),
                                          [](bool floor) { return floor; });
        const bool small =
            minimum_.remaining < std::max(rounding_sds, floor_sds * (at_floor ? 1.0 : std::min(rounding_, 1.0)));
        if ((hopeless || (rejected >= 4 && small)) && tighten(true)) {
            rejected = 0;
            continue;
        }
        if (hopeless || (rejected >= 4 && small)) {
            minimum_.outcome = small ? Outcome::converged : Outcome::no_progress;
            minimum_.message = (small ? "no shorter step decreases the objective and the full step that is left is "
                                      : "no step decreases the objective although the full step that is left is ") +
                               figures("%.2g", minimum_.remaining) + " posterior sds" +
                               (small ? ": the rounding of the residuals is reached" : "");
            break;
        }
        if (ledger_.trials >= problem_.options.maximum_iterations) {
            minimum_.outcome = Outcome::iteration_limit;
            minimum_.message = "the limit of " + std::to_string(problem_.options.maximum_iterations) +
                               " steps is reached; the full step that is left is " +
                               figures("%.2g", minimum_.remaining) + " posterior sds";
            break;
        }
        if (met) ++polish;
        last_remaining = minimum_.remaining;
        TrialStep step = full.length <= 1.1 * radius_ ? full : step_within(model_, radius_);
        if (set_.constraints > 0 && minimum_.matching > exact_matching) ++stage_trials_;
        if (unsettled()) break;
        last_step_full_ = step.mu == 0.0;
        if (last_step_full_ && rejected == 0 && minimum_.remaining < near_sds) stretch(step, stretch_);
        if (try_step(step)) {
            rejected = 0;
            for (std::size_t b = 0; b < failures_.size(); ++b) {
                failures_[b] = cut_[b] ? failures_[b] + 1 : 0;
                cut_[b] = false;
            }
            if (stopped_blocks([this](std::size_t b) { return failures_[b] >= 3; })) break;
            if (!update_errors(last_step_full_ && gain_ > 0.5 && gain_ < 1.5)) break;
            tighten(false);
            if (set_.provisional &&
                (accepted_ >= provisional_steps || !(last_decrease_ >= provisional_gain * last_objective_))) {
                minimum_.outcome = Outcome::converged;
                minimum_.message = "a provisional round is over";
                break;
            }
            continue;
        }
        ++rejected;
        // Eight shortenings are a factor of 65000: no step worth taking gets past this block.
        if (rejected == 8 && stopped_blocks([this](std::size_t b) { return cut_[b]; })) break;
    }
    return std::move(minimum_);
}

}  // namespace

ErrorProblem error_problem(const Problem& problem, const BlockSet& set, const Minimum& minimum, Follow follow) {
    ErrorProblem errors;
    errors.set = &set;
    errors.laws = &problem.laws;
    errors.rows = in_basis(minimum.rows, minimum.step.from_data);
    errors.prior_rows = minimum.prior.rows * minimum.step.decided;
    errors.prior_gradient = minimum.step.decided.transpose() * minimum.prior.gradient;
    errors.free = free_errors(problem, set);
    errors.matching = minimum.matching;
    errors.restricted = problem.options.variance == Variance::restricted;
    errors.follow = follow;
    return errors;
}

Minimum minimise(const Problem& problem, const BlockSet& set, State& state, Ledger& ledger) {
    const State start = state;
    Minimisation unlimited(problem, set, state, ledger, false);
    Minimum minimum = unlimited.run();
    if (!unlimited.unsettled()) return minimum;
    state = start;
    return Minimisation(problem, set, state, ledger, true).run();
}

}  // namespace orbid::estimator
