#include "apps/campaign/plan/campaign_file.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "apps/campaign/plan/campaign_fields.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/documents/schema_check.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"
#include "apps/job/reading/job_reader.hpp"

namespace orbid::apps {

namespace {

constexpr std::int64_t most_checked = 1000;

/// What a kind needs besides its keys.
void check_kind(ObjectReader& root, const Campaign& campaign) {
    using Kind = Campaign::Kind;
    if (campaign.kind == Kind::compare_models && campaign.jobs.size() < 2)
        root.report("jobs", "must name at least two jobs: models to compare");
    const bool nothing_varies = campaign.factors.empty() && campaign.draws.empty() && campaign.jobs.size() == 1;
    if (campaign.kind == Kind::sweep && nothing_varies && campaign.replicates == 1)
        root.report("kind", "\"sweep\" needs \"vary\": nothing varies, there is one task");
    if (!campaign.draws.empty() && campaign.replicates == 1)
        root.report("vary", "a \"draw\" is drawn for every replicate: add \"replicates\"");
}

/// Problems of the jobs of a campaign, each at the key that led to it.
class JobCheck {
public:
    JobCheck(const CampaignTasks& tasks, ObjectReader& root) : tasks_(tasks), root_(root) {}

    void run() {
        const std::int64_t groups = tasks_.count() / tasks_.campaign().replicates;
        const std::int64_t step = std::max<std::int64_t>(1, (groups + most_checked - 1) / most_checked);
        for (std::int64_t group = 0; group < groups && complaints_ < 5; group += step)
            check(group * tasks_.campaign().replicates);
        if (step > 1 && complaints_ == 0) check((groups - 1) * tasks_.campaign().replicates);
    }

private:
    void check(std::int64_t number) {
        const JobReading reading = read_job(tasks_.job_text(number), tasks_.base(number).source);
        for (const Problem& problem : reading.problems)
            complain(number, problem);
        if (reading.job) check_task(number, *reading.job);
    }

    void check_task(std::int64_t number, const Job& job) {
        const Campaign& campaign = tasks_.campaign();
        if (!job.estimate) return complain(number, {{}, "", "the job has no \"estimate\": nothing to tell of it"});
        if (campaign.kind == Campaign::Kind::coverage && !simulates_all_data(job) && tasks_.known(number).empty())
            complain(number, {{}, "/data", "coverage needs data that the job simulates, or \"truth\" in the campaign"});
    }

    /// Once each, at what varies there; otherwise at the job.
    void complain(std::int64_t number, const Problem& problem) {
        std::string text = fmt::format("{}{}{}", problem.pointer, problem.pointer.empty() ? "" : ": ", problem.rule);
        if (!told_.insert(text).second) return;
        ++complaints_;
        const TaskPlan plan = tasks_.plan(number);
        std::string values;
        for (std::size_t i = 0; i < plan.values.size(); ++i)
            values += fmt::format("{}{} = {}", values.empty() ? "" : ", ", tasks_.columns()[i].name, plan.values[i]);
        text =
            fmt::format("the job of task {}{} is refused: {}", number, values.empty() ? "" : " (" + values + ")", text);
        const auto at = root_.find(key_of(problem.pointer));
        if (!at)
            root_.self().report(text);
        else if (problem.kind == Problem::Kind::data)
            at->report_data(text);
        else
            at->report(text);
    }

    /// The key of the campaign that a value of the job comes from.
    [[nodiscard]] std::string key_of(const std::string& pointer) const {
        const Campaign& campaign = tasks_.campaign();
        for (const VariedColumn& column : tasks_.columns()) {
            if (column.pointer.empty() || !(pointer + "/").starts_with(column.pointer + "/")) continue;
            if (is_in(column.name, campaign.held)) return "grid";
            if (campaign.kind == Campaign::Kind::records && column.name == "record") return "records";
            return column.name == "seed" ? "seed" : "vary";
        }
        if (campaign.kind == Campaign::Kind::bootstrap) return "run";
        return campaign.jobs.size() > 1 ? "jobs" : "job";
    }

    const CampaignTasks& tasks_;
    ObjectReader& root_;
    std::set<std::string> told_;
    int complaints_ = 0;
};

void read_root(const ValueReader& value, CampaignText& text) {
    ObjectReader root(value);
    (void)root.find("$schema");
    read_fields(root, campaign_fields(), text, text.place);
    root.finish();
    Campaign& campaign = text.campaign;
    if (value.problem_count() > 0) return;
    campaign.seeded = campaign.seeded || campaign.replicates > 1 || !campaign.draws.empty();
    check_kind(root, campaign);
    if (value.problem_count() > 0) return;
    const double count = CampaignTasks::count_of(campaign);
    if (count > static_cast<double>(CampaignTasks::most))
        return root.self().report(
            fmt::format("makes {:.6g} tasks, at most {} can be run: fewer values in \"vary\", or "
                        "fewer \"replicates\"",
                        count, CampaignTasks::most));
    try {
        const CampaignTasks tasks(campaign);
        JobCheck(tasks, root).run();
    } catch (const std::invalid_argument& error) {
        root.self().report(error.what());
    }
}

}  // namespace

int CampaignReading::exit_code() const {
    if (problems.empty()) return 0;
    const bool only_data =
        std::all_of(problems.begin(), problems.end(), [](const Problem& p) { return p.kind == Problem::Kind::data; });
    return only_data ? 3 : 2;
}

CampaignReading read_campaign(std::string_view text, const std::filesystem::path& source) {
    JsonDocument document = parse_json(text);
    CampaignReading reading;
    reading.problems = std::move(document.problems);
    CampaignText read;
    read.place.source = std::filesystem::absolute(source).lexically_normal();
    read.raw = json_value_or_discarded<nlohmann::ordered_json>(text, true);
    if (document.root) {
        check_described(*document.root, campaign_description(), reading.problems);
        read_root(ValueReader(*document.root, "", reading.problems, &campaign_description()), read);
    }
    std::stable_sort(reading.problems.begin(), reading.problems.end(), [](const Problem& a, const Problem& b) {
        return a.place.line != b.place.line ? a.place.line < b.place.line : a.place.column < b.place.column;
    });
    if (reading.problems.empty()) reading.campaign = std::move(read.campaign);
    return reading;
}

bool simulates_all_data(const Job& job) {
    return !job.data.empty() && std::all_of(job.data.begin(), job.data.end(),
                                            [](const DataJob& data) { return data.simulation.has_value(); });
}

bool is_campaign(std::string_view text) {
    // Of a large job only this is read.
    if (text.find("\"kind\"") == std::string_view::npos) return false;
    const auto document = json_value_or_discarded<nlohmann::ordered_json>(text, true);
    return document.is_object() && document.contains("kind") &&
           (document.contains("job") || document.contains("jobs") || document.contains("run"));
}

std::string campaign_summary(const Campaign& campaign) {
    const CampaignTasks tasks(campaign);
    std::string text =
        fmt::format("{}\n  kind       {}\n  tasks      {}\n", campaign.title.empty() ? "a campaign" : campaign.title,
                    campaign_kind_names[static_cast<std::size_t>(campaign.kind)], tasks.count());
    if (campaign.jobs.size() > 1) text += fmt::format("  jobs       {}\n", campaign.jobs.size());
    for (const VariedFactor& factor : campaign.factors)
        for (std::size_t key = 0; key < factor.names.size(); ++key)
            text += fmt::format("  varies     {}: {} values of {}\n", factor.names[key], factor.settings.size(),
                                factor.pointers[key]);
    for (const VariedDraw& draw : campaign.draws)
        text += fmt::format("  drawn      {}: {}\n", draw.name, draw.pointer);
    if (campaign.seeded)
        text += fmt::format("  seeds      {} to {}\n", campaign.seed,
                            campaign.seed + static_cast<std::uint64_t>(campaign.replicates - 1));
    if (campaign.seconds > 0.0) text += fmt::format("  limit      {} s for each task\n", campaign.seconds);
    return text;
}

}  // namespace orbid::apps
