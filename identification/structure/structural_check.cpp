#include "identification/structure/structural_check.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <optional>

#include <fmt/format.h>

#include "identification/structure/course_draw.hpp"
#include "identification/structure/null_direction.hpp"
#include "identification/structure/sign_choice.hpp"
#include "orbits/observability/rank_test.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

constexpr std::size_t most_draws = 3;
/// Coordinates and parameters: the cost of derivatives grows with the square of their number.
constexpr Eigen::Index most_directions = 100;

/// Why there is nothing to examine; empty: there is.
std::string obstacle(const IdentificationProblem& problem, const EstimateSetup& setup) {
    if (!problem.series) return "no series is fitted";
    if (problem.cycles || problem.waveform || problem.branch) return "other data than series are fitted with them";
    if (problem.system->kind() == models::Kind::map) return "the model is a map";
    if (problem.system->dimension() + std::ssize(setup.parameters) > most_directions)
        return fmt::format("there are more than {} coordinates and parameters", most_directions);
    for (const std::size_t e : problem.series->data) {
        if (problem.experiments[e].series->sampling != orbits::Series::Sampling::samples)
            return "the series are sections";
    }
    return {};
}

std::vector<double> finite_values(const orbits::Segment& segment, Eigen::Index row) {
    std::vector<double> values;
    std::copy_if(segment.values.row(row).begin(), segment.values.row(row).end(), std::back_inserter(values),
                 [](double value) { return std::isfinite(value); });
    return values;
}

/// What one draw of parameters says.
struct Draw {
    orbits::RankTest test;
    std::vector<CourseInformation> courses;
    /// By experiment of the problem: the fewest directions of its own unknowns that no reading of a course feels.
    std::vector<Eigen::Index> own;
    bool complete = false;  ///< every unknown is determined
};

class StructuralCheck {
public:
    StructuralCheck(const IdentificationProblem& problem, const EstimateSetup& setup)
        : problem_(problem), setup_(setup), shared_(shared_unknowns(problem, setup)), draws_(problem, setup, shared_) {}

    [[nodiscard]] StructuralReport run();

private:
    [[nodiscard]] Draw draw(std::size_t number);
    [[nodiscard]] bool is_complete(const Draw& draw) const;
    void refuse_silent(const std::vector<Draw>& draws) const;
    void refuse_uncoupled(const Draw& draw) const;
    void refuse_few(Eigen::Index held) const;
    [[nodiscard]] std::vector<NullSpace> null_spaces(const std::vector<Draw>& draws, Eigen::Index count) const;

    const IdentificationProblem& problem_;
    const EstimateSetup& setup_;
    SharedUnknowns shared_;
    CourseDraws draws_;
};

bool StructuralCheck::is_complete(const Draw& draw) const {
    const Eigen::VectorXd values = draw.test.singular_values();
    return (values.size() == 0 || values.minCoeff() > orbits::no_effect) &&
           std::all_of(problem_.series->data.begin(), problem_.series->data.end(),
                       [&](std::size_t e) { return draw.own[e] == 0; });
}

Draw StructuralCheck::draw(std::size_t number) {
    constexpr Eigen::Index unknown = 1000000;
    Draw draw{orbits::RankTest(shared_.size()), {}, std::vector<Eigen::Index>(problem_.experiments.size(), unknown)};
    for (std::size_t j = 0; j < shared_.known.size(); ++j)
        if (shared_.known[j]) draw.test.know(static_cast<Eigen::Index>(j));
    std::size_t most = 0;
    for (const std::size_t e : problem_.series->data)
        most = std::max(most, draws_.courses(e));
    for (std::size_t k = 0; k < most && !draw.complete; ++k) {
        for (const std::size_t e : problem_.series->data) {
            if (k >= draws_.courses(e)) continue;
            CourseInformation course = draws_.course(e, k, number);
            if (!course.usable()) continue;
            const Eigen::Index own =
                draw.test.add(course.by_own, course.by_shared, course.own_terms, course.shared_terms);
            draw.own[e] = std::min(draw.own[e], own);
            draw.courses.push_back(std::move(course));
        }
        draw.complete = is_complete(draw);
    }
    return draw;
}

/// A channel whose reading depends on nothing in all courses.
void StructuralCheck::refuse_silent(const std::vector<Draw>& draws) const {
    for (const std::size_t e : problem_.series->data) {
        const Experiment& data = problem_.experiments[e];
        for (std::size_t r = 0; r < data.observe.size(); ++r) {
            bool silent = true, any = false;
            for (const Draw& draw : draws)
                for (const CourseInformation& course : draw.courses) {
                    if (course.experiment != e) continue;
                    any = true;
                    silent = silent && course.silent[r];
                }
            if (!any || !silent) continue;
            const auto coordinate = static_cast<std::size_t>(data.observe[r]);
            const models::Expression* formula = models::reading_function(data.sensor, coordinate);
            throw orbits::DataError(fmt::format(
                "{}: the reading of {}{} depends on no coordinate and on no estimated parameter: it determines "
                "nothing; "
                "correct the sensor, or leave {} out of \"observe\"",
                data.name, problem_.coordinate(data.observe[r]).name,
                formula == nullptr ? "" : ", " + formula->text() + ",", problem_.coordinate(data.observe[r]).name));
        }
    }
}

/// Directions of the first state alone that no reading feels.
void StructuralCheck::refuse_uncoupled(const Draw& draw) const {
    for (const std::size_t e : problem_.series->data) {
        if (draw.own[e] == 0) continue;
        const auto course = std::find_if(draw.courses.begin(), draw.courses.end(),
                                         [&](const CourseInformation& one) { return one.experiment == e; });
        if (course == draw.courses.end()) continue;
        const Eigen::MatrixXd null = orbits::null_space(course->by_own, course->own_terms);
        if (null.cols() == 0) continue;
        std::vector<std::string> names;
        for (Eigen::Index i = 0; i < null.rows(); ++i) {
            const Eigen::Index coordinate = course->own[static_cast<std::size_t>(i)];
            const double size = std::max(std::abs(course->state[coordinate]), 1e-300);
            constexpr double part = 1e-4;
            if (null.row(i).cwiseAbs().maxCoeff() > part * size)
                names.emplace_back(problem_.coordinate(coordinate).name);
        }
        const bool one = names.size() == 1, silent = null.cols() == std::ssize(names);
        throw orbits::DataError(
            fmt::format("{}: no record determines where {} begin{}: {}; remove {} from the model, or give the value by "
                        "\"initial_state\": {{ \"{}\": {{ \"value\": ... }} }} with \"interval\": \"segment\"",
                        problem_.experiments[e].name, fmt::join(names, ", "), one ? "s" : "",
                        silent ? (one ? "it never acts on what is measured" : "they never act on what is measured")
                               : "only combinations of them act on what is measured",
                        one      ? "it"
                        : silent ? "them"
                                 : "one of them",
                        names.back()));
    }
}

/// Fewer readings than unknowns, or nothing that changes, in all series together.
void StructuralCheck::refuse_few(Eigen::Index held) const {
    std::size_t readings = 0, states = 0;
    bool changes = false;
    std::vector<std::string_view> names;
    for (const std::size_t e : problem_.series->data) {
        const Experiment& data = problem_.experiments[e];
        names.push_back(data.name);
        std::size_t own = 0;
        for (std::size_t i = 0; i < problem_.system->coordinates().size(); ++i) {
            const InitialValue initial = i < data.initial_state.size() ? data.initial_state[i] : InitialValue{};
            own += initial.estimate && !estimator::is_proper(initial.prior) ? 1 : 0;
        }
        for (const std::size_t segment : data.fitted_segments()) {
            states += own;
            for (const Eigen::Index i : data.observe)
                for (Eigen::Index row = 0; row < data.series->dimension(); ++row) {
                    if (data.series->coordinate(row).name != problem_.coordinate(i).name) continue;
                    const std::vector<double> values = finite_values(data.series->segments[segment], row);
                    readings += values.size();
                    changes = changes ||
                              std::adjacent_find(values.begin(), values.end(), std::not_equal_to<>()) != values.end();
                }
        }
    }
    const auto flat = static_cast<std::size_t>(std::count(shared_.known.begin(), shared_.known.end(), false) - held);
    if (readings > flat + states && !changes)
        throw orbits::DataError(fmt::format(
            "{}: no reading differs from the one before: nothing moves, and nothing is determined; is this the column?",
            fmt::join(names, ", ")));
    if (readings > flat + states) return;
    throw orbits::DataError(
        fmt::format("{}: too short: {} readings for {} free parameters and {} initial values; at least {} are needed",
                    fmt::join(names, ", "), readings, flat, states, flat + states + 1));
}

/// The null directions of every draw, completed by the first states of its courses; the clearest draw comes first.
std::vector<NullSpace> StructuralCheck::null_spaces(const std::vector<Draw>& draws, Eigen::Index count) const {
    const Eigen::Index p = shared_.size(), n = problem_.system->dimension();
    const auto is_free = [n](const CourseInformation& course) { return std::ssize(course.own) == n; };
    std::vector<NullSpace> spaces;
    std::vector<std::size_t> order;
    for (std::size_t k = 0; k < draws.size(); ++k)
        if (draws[k].test.null_directions().cols() == count) order.push_back(k);
    // What is hardly determined spoils directions that are not: take the draw where it is determined best.
    const auto least = [&](std::size_t k) { return p > count ? draws[k].test.singular_values()[p - count - 1] : 1.0; };
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return least(a) > least(b); });
    for (const std::size_t number : order) {
        const Draw& draw = draws[number];
        const Eigen::MatrixXd null = draw.test.null_directions();
        const Eigen::VectorXd theta = draws_.parameters(number);
        // A first value that is given is no part of a scaling there, but of the others.
        const bool any = std::any_of(draw.courses.begin(), draw.courses.end(), is_free);
        for (const CourseInformation& course : draw.courses) {
            if (any && !is_free(course)) continue;
            NullSpace space{Eigen::MatrixXd::Zero(p + n, count), Eigen::VectorXd::Ones(p + n)};
            space.directions.topRows(p) = null;
            for (Eigen::Index j = 0; j < p; ++j)
                space.values[j] = theta[static_cast<Eigen::Index>(shared_.parameter[static_cast<std::size_t>(j)])];
            for (Eigen::Index k = 0; k < count; ++k) {
                const Eigen::VectorXd own =
                    orbits::compensation(course.by_own, course.by_shared, course.own_terms, null.col(k));
                for (std::size_t i = 0; i < course.own.size(); ++i)
                    space.directions(p + course.own[i], k) = own[static_cast<Eigen::Index>(i)];
            }
            for (const Eigen::Index i : course.own)
                if (course.state[i] != 0.0) space.values[p + i] = course.state[i];
            spaces.push_back(std::move(space));
        }
    }
    return spaces;
}

StructuralReport StructuralCheck::run() {
    StructuralReport report;
    std::vector<Draw> draws;
    for (std::size_t k = 0; k < most_draws; ++k) {
        draws.push_back(draw(k));
        if (draws.back().courses.empty()) {
            report.reason = "the model cannot be followed from the states of the record";
            return report;
        }
        if (draws.back().complete) break;
    }
    report.examined = true;
    refuse_silent(draws);
    if (!draws.back().complete) {
        Eigen::Index count = shared_.size();
        for (const Draw& one : draws)
            count = std::min(count, one.test.null_directions().cols());
        const auto fewest = [&](const Draw& one) {
            Eigen::Index sum = 0;
            for (const std::size_t e : problem_.series->data)
                sum += one.own[e];
            return sum;
        };
        refuse_uncoupled(*std::min_element(draws.begin(), draws.end(),
                                           [&](const Draw& a, const Draw& b) { return fewest(a) < fewest(b); }));
        if (count > 0) {
            std::vector<std::string> names;
            for (const std::size_t i : shared_.parameter)
                names.push_back(setup_.parameters[i].name);
            for (const models::Coordinate& coordinate : problem_.system->coordinates())
                names.emplace_back(coordinate.name);
            report.directions = named_directions(null_spaces(draws, count), names, shared_.size());
        }
    }
    refuse_few(std::ssize(report.directions));
    report.signs = sign_choices(problem_, setup_, draws_, draws.front().courses);
    return report;
}

}  // namespace

StructuralReport structural_report(const IdentificationProblem& problem, const EstimateSetup& setup) {
    StructuralReport report;
    report.reason = obstacle(problem, setup);
    return report.reason.empty() ? StructuralCheck(problem, setup).run() : report;
}

void hold(const StructuralReport& report, std::vector<estimator::FreeParameter>& parameters) {
    for (const UndeterminedDirection& direction : report.directions)
        for (estimator::FreeParameter& parameter : parameters)
            if (parameter.name == direction.held) parameter.lower = parameter.upper = parameter.start;
}

std::vector<std::string> remarks(const StructuralReport& report) {
    std::vector<std::string> lines;
    for (const UndeterminedDirection& direction : report.directions)
        lines.push_back(fmt::format("{}: {} is held at its start, and what is estimated holds for that value",
                                    direction.text, direction.held));
    for (const std::vector<std::string>& signs : report.signs)
        lines.push_back(fmt::format("the sign of {} is a matter of choice: (-{}) gives the same readings",
                                    fmt::join(signs, ", "), fmt::join(signs, ", -")));
    return lines;
}

}  // namespace orbid::identification
