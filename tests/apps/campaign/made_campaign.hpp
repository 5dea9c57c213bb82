#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "apps/campaign/journal/journal.hpp"
#include "apps/documents/compression.hpp"
#include "apps/documents/fingerprint.hpp"

namespace orbid::tests {

/// A campaign that varies noise (3 levels) and a seed; outcomes follow from the number of the task.
inline apps::JournalHead made_head(std::int64_t tasks) {
    return {.title = "noise and seeds",
            .kind = "grid",
            .document = "{\"tasks\": \"all\"}\n",
            .key = apps::sha256("made"),
            .version = "0.1.0",
            .created = 1.7e9,
            .tasks = tasks,
            .varied = {{"noise", "/data/simulate/noise"}, {"seed", "/data/simulate/seed", true}}};
}

inline apps::TaskPlan made_plan(std::int64_t number) {
    static const std::vector<std::string> noises{"0.01", "0.02", "0.05"};
    return {.number = number,
            .key = apps::sha256(std::to_string(number)),
            .values = {noises[static_cast<std::size_t>(number % 3)], std::to_string(number / 3)},
            .seed = number / 3};
}

inline std::vector<apps::TaskPlan> made_plans(std::int64_t tasks) {
    std::vector<apps::TaskPlan> plans;
    for (std::int64_t number = 0; number < tasks; ++number)
        plans.push_back(made_plan(number));
    return plans;
}

inline std::string made_result(std::int64_t number) {
    return fmt::format("{{\"objective\": {}}}\n", number);
}

/// A number in [-1.7, 1.7) with mean 0 and sd 1, from a number: the golden ratio's fractions are spread evenly.
inline double made_z(std::int64_t number, int parameter) {
    const double x = static_cast<double>(number + 1) * (0.6180339887498949 + 0.1 * parameter);
    return std::sqrt(12.0) * (x - std::floor(x) - 0.5);
}

/// Every tenth task fails, every tenth after it does not converge.
inline apps::TaskOutcome made_outcome(std::int64_t number) {
    apps::TaskOutcome out{.number = number,
                          .state = apps::TaskState::done,
                          .exit_code = 0,
                          .status = "converged",
                          .message = {},
                          .objective = 0.5 + 1e-3 * static_cast<double>(number),
                          .parameters = {},
                          .result = {},
                          .started = 1.7e9 + static_cast<double>(number),
                          .seconds = 0.5 + 0.25 * static_cast<double>(number % 4),
                          .processor_seconds = 1.0,
                          .host = "node7",
                          .rank = static_cast<int>(number % 5)};
    if (number % 10 == 3) {
        out.state = apps::TaskState::failed;
        out.exit_code = 3;
        out.status = "data";
        out.message = fmt::format("no crossing in \"{}\", which is short", number % 20 == 3 ? "a" : "b");
        out.objective = std::numeric_limits<double>::quiet_NaN();
        return out;
    }
    if (number % 10 == 4) {
        out.exit_code = 1;
        out.status = "not converged";
        out.message = "the limit of iterations was reached";
    }
    const double noise = number % 3 == 0 ? 0.01 : number % 3 == 1 ? 0.02 : 0.05;
    const std::vector<std::string> names{"gamma", "omega"};
    for (int k = 0; k < 2; ++k) {
        const double truth = k == 0 ? 0.3 : 2.0;
        const double value = truth + noise * made_z(number, k);
        out.parameters.push_back({.name = names[static_cast<std::size_t>(k)],
                                  .value = value,
                                  .sd = noise,
                                  .lower = value - 1.6 * noise,
                                  .upper = value + 1.6 * noise,
                                  .truth = truth,
                                  .bound = 0.9 * noise});
    }
    // An estimate of an error has no truth, and its interval may be unknown.
    out.parameters.push_back({.name = "sigma", .value = noise, .sd = 0.1 * noise});
    out.result = apps::compressed(made_result(number));
    return out;
}

inline std::vector<apps::TaskOutcome> made_outcomes(std::int64_t tasks) {
    std::vector<apps::TaskOutcome> out;
    for (std::int64_t number = 0; number < tasks; ++number)
        out.push_back(made_outcome(number));
    return out;
}

/// A journal with all tasks, the first `ended` of which have run.
inline void make_campaign(const std::filesystem::path& file, std::int64_t tasks, std::int64_t ended) {
    auto journal = apps::Journal::create(file, made_head(tasks));
    journal.add_tasks(made_plans(tasks));
    journal.store(made_outcomes(ended));
}

inline bool same_number(double a, double b) {
    return a == b || (std::isnan(a) && std::isnan(b));
}

inline bool same_outcome(const apps::TaskOutcome& a, const apps::TaskOutcome& b) {
    bool same = a.number == b.number && a.state == b.state && a.exit_code == b.exit_code && a.status == b.status &&
                a.message == b.message && same_number(a.objective, b.objective) && a.started == b.started &&
                a.seconds == b.seconds && a.processor_seconds == b.processor_seconds && a.host == b.host &&
                a.rank == b.rank && a.parameters.size() == b.parameters.size();
    for (std::size_t k = 0; same && k < a.parameters.size(); ++k) {
        const auto& p = a.parameters[k];
        const auto& q = b.parameters[k];
        same = p.name == q.name && same_number(p.value, q.value) && same_number(p.sd, q.sd) &&
               same_number(p.lower, q.lower) && same_number(p.upper, q.upper) && same_number(p.truth, q.truth) &&
               same_number(p.bound, q.bound);
    }
    return same;
}

inline bool same_plan(const apps::TaskPlan& a, const apps::TaskPlan& b) {
    return a.number == b.number && a.key == b.key && a.values == b.values && a.seed == b.seed;
}

}  // namespace orbid::tests
