#include "apps/program/starting/starting_campaign.hpp"

#include <map>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "apps/campaign/plan/campaign.hpp"

namespace orbid::apps {

namespace {

/// A job that simulates its own record, and estimates from it within milliseconds.
constexpr std::string_view simulating_job = R"(  // The job that is varied; "job": "job.json" names a file instead.
  "job": {
    "model": { "name": "free_pendulum", "parameters": { "w0sq": 30, "c2": 0.05 } },
    "data": {
      "simulate": {
        "samples": { "step": 0.02, "count": 201 },
        "noise": { "phi": 0.005, "phi_dot": 0.02 },   // drawn anew from the seed of each task
        "initial": [[1.0, 0.0]]
      }
    },
    "estimate": {
      "parameters": { "w0sq": { "start": 33 }, "c2": { "start": 0.1 } },
      "residuals": [ { "type": "series" } ]
    }
  },
)";

/// Estimates from a record that is there.
std::string recorded_job(std::string_view file, std::string_view parameters, std::string_view held = "") {
    return fmt::format(R"({{
      "model": {{ "name": "free_pendulum"{} }},
      "data": {{ "file": "{}", "kind": "samples",
                "columns": {{ "time": "t", "phi": "phi", "phi_dot": "phi_dot" }} }},
      "estimate": {{ "parameters": {{ {} }},
                    "residuals": [ {{ "type": "series" }} ] }}
    }})",
                       held.empty() ? "" : fmt::format(R"(, "parameters": {{ {} }})", held), file, parameters);
}

struct StartingCampaign {
    std::string purpose;                ///< one line
    std::vector<std::string> commands;  ///< that make what it needs, before it can run
    std::string body;                   ///< its keys
};

const StartingCampaign& campaign_of(Campaign::Kind kind) {
    using Kind = Campaign::Kind;
    static const std::map<Kind, StartingCampaign> all{
        {Kind::sweep,
         {"A sweep: how do the estimates depend on the length of the record and on its noise?",
          {},
          std::string(simulating_job) + R"(  // Each with all values of the others: 3 x 3 settings, 4 times each.
  "vary": [
    { "key": "/data/simulate/samples/count", "name": "samples", "values": [101, 201, 401] },
    // Several keys that go together: one list for each setting.
    { "keys": ["/data/simulate/noise/phi", "/data/simulate/noise/phi_dot"],
      "values": [[0.001, 0.004], [0.005, 0.02], [0.02, 0.08]] }
    // { "key": "/model/parameters/c2", "range": { "from": 0.01, "to": 1, "count": 5, "spacing": "log" } }
    // { "key": "/estimate/parameters/w0sq/start", "draw": { "uniform": [25, 35] } }
  ],
  "seed": 1,                  // of the first replicate; the next ones follow
  "replicates": 4
)"}},
        {Kind::coverage,
         {"Coverage: do 95 of 100 intervals hold the true value?",
          {},
          std::string(simulating_job) + R"(  "seed": 1,                  // of the first replicate; the next ones follow
  "replicates": 40            // 1000 tell 95 % from 93 %
)"}},
        {Kind::bootstrap,
         {"A bootstrap: the data of a finished run are drawn anew at its estimates.",
          {"orbid new free_pendulum series > swing.json", "orbid run swing.json"},
          R"(  "run": "swing",             // folder of the run
  "seed": 1,                  // of the first replicate; the next ones follow
  "replicates": 20
)"}},
        {Kind::profile_grid,
         {"A grid: parameters are held at each value, and the others are estimated.",
          {},
          std::string(simulating_job) + R"(  "grid": {
    "c2": { "from": 0, "to": 0.1, "count": 11 }       // or a list of values
    // A second parameter makes a plane.
  }
)"}},
        {Kind::compare_models,
         {"A comparison: which friction does a swinging pendulum have?",
          {"orbid new free_pendulum series > swing.json", "orbid simulate swing.json"},
          R"(  // By the names that tables show; files of jobs may stand here instead: "jobs": "models/*.json".
  "jobs": {
    "dry": )" +
              recorded_job("swing/series.csv", R"("w0sq": { "start": 33 }, "c1": { "start": 0.1 })", R"("c2": 0)") +
              ",\n    \"linear\": " +
              recorded_job("swing/series.csv", R"("w0sq": { "start": 33 }, "c2": { "start": 0.1 })") +
              ",\n    \"quadratic\": " +
              recorded_job("swing/series.csv", R"("w0sq": { "start": 33 }, "c3": { "start": 0.1 })", R"("c2": 0)") + R"(
  }
)"}},
        {Kind::records,
         {"Records: one job for many files.",
          {"orbid new free_pendulum series > swing.json",
           "for n in 1 2 3 4; do sed \"s/\\\"seed\\\": 1/\\\"seed\\\": $n/\" swing.json > swing_$n.json; "
           "orbid simulate swing_$n.json; done"},
          R"(  "job": )" + recorded_job("swing_1/series.csv", R"("w0sq": { "start": 33 }, "c2": { "start": 0.1 })") +
              R"(,
  "records": "swing_*/series.csv",
  "record_key": "/data/file"  // the key of the job that takes each path
)"}}};
    return all.at(kind);
}

}  // namespace

std::vector<std::string> starting_campaign_kinds() {
    return campaign_kind_names;
}

std::string starting_campaign(std::string_view kind) {
    for (std::size_t i = 0; i < campaign_kind_names.size(); ++i) {
        if (campaign_kind_names[i] != kind) continue;
        const StartingCampaign& starting = campaign_of(static_cast<Campaign::Kind>(i));
        std::string text =
            fmt::format("// {}\n// Run with `orbid campaign FILE`; the same command goes on.\n", starting.purpose);
        if (!starting.commands.empty()) text += "// It needs what these commands make:\n";
        for (const std::string& command : starting.commands)
            text += fmt::format("//     {}\n", command);
        return text +
               fmt::format(
                   "{{\n  \"$schema\": \"orbid-campaign.schema.json\",   // from `orbid schema --campaign`\n"
                   "  \"kind\": \"{}\",\n",
                   kind) +
               starting.body + "}\n";
    }
    throw std::invalid_argument(
        fmt::format("there is no kind of campaign \"{}\"; kinds: {}", kind, fmt::join(campaign_kind_names, ", ")));
}

}  // namespace orbid::apps
