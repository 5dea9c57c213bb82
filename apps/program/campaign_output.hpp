#pragma once
#include <fmt/format.h>
#include <filesystem>
#include <ostream>
#include <string>
#include <vector>
#include "apps/campaign/journal/journal.hpp"
namespace orbid::apps {
enum class CampaignTable { tasks, parameters, summary };
inline const std::vector<std::string> campaign_table_names{"tasks", "parameters", "summary"};
struct TableOptions {
    CampaignTable table = CampaignTable::tasks;
    bool times = false;
};
inline void write_campaign_table(const Journal& j, std::ostream& out, const TableOptions&) {
    j.each_row([&](const Journal::Row& r) {
        out << r.plan.number << ' ' << static_cast<int>(r.outcome.state) << ' ' << r.outcome.status << ' '
            << r.outcome.message << ' ' << r.outcome.objective;
        for (auto& v : r.plan.values)
            out << ' ' << v;
        for (auto& p : r.outcome.parameters)
            out << ' ' << p.name << ' ' << fmt::format("{} {} {} {} {}", p.value, p.sd, p.lower, p.upper, p.truth);
        out << '\n';
    });
}
inline std::string campaign_status(const Journal& j) {
    auto c = j.counts();
    return fmt::format("{} done, {} failed, {} waiting, {} s, {} s cpu\n", c.done, c.failed, c.waiting, c.seconds,
                       c.processor_seconds);
}
inline void write_campaign_report(const Journal&, const std::filesystem::path&) {}
class LiveReport {
public:
    LiveReport(const Journal&, const std::filesystem::path&) {}
    void renew() {}
    void finish() {}
};
}  // namespace orbid::apps
