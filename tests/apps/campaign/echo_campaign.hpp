#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/campaign/engine/campaign_run.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"

namespace orbid::tests {

/// Tasks whose job holds the numbers "size" and "seed" and nothing that orbid would run.
inline apps::Campaign made_campaign(std::vector<nlohmann::ordered_json> sizes, std::int64_t replicates) {
    apps::Campaign campaign;
    campaign.jobs.push_back({"", R"({ "size": 0, "seed": 0 })", "/job.json"});
    apps::VariedFactor factor{{"size"}, {"/size"}, {}};
    for (const auto& size : sizes)
        factor.settings.push_back({size});
    campaign.factors.push_back(factor);
    campaign.replicates = replicates;
    campaign.seeded = true;
    return campaign;
}

inline nlohmann::json numbers(const std::string& text) {
    return nlohmann::json::parse(text);
}

/// An estimate that is its job's size and seed.
inline apps::TaskRun echo(const std::string& text) {
    const auto job = numbers(text);
    const double value = job["size"].get<double>() + 1e-3 * job["seed"].get<double>();
    apps::TaskRun run;
    run.result =
        nlohmann::json{{"status", "converged"},
                       {"message", "as it was asked"},
                       {"objective", value},
                       {"parameters", {{"k", {{"value", value}, {"sd", 0.5}, {"interval95", {value - 1, value + 1}}}}}}}
            .dump();
    return run;
}

inline std::map<std::int64_t, apps::Journal::Row> rows(const apps::Journal& journal) {
    std::map<std::int64_t, apps::Journal::Row> all;
    journal.each_row([&](const apps::Journal::Row& row) { all[row.plan.number] = row; });
    return all;
}

inline bool run(const apps::CampaignTasks& tasks, apps::Journal& journal, apps::Engine engine,
                const apps::TaskRunner& runner, const apps::DealerCalls& calls = {}) {
    apps::CampaignOptions options;
    options.engine = engine;
    options.ranks = 2;
    return apps::run_campaign(tasks, journal, options, runner, calls);
}

}  // namespace orbid::tests
