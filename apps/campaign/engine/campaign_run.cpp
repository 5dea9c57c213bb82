#include "apps/campaign/engine/campaign_run.hpp"

#include <algorithm>
#include <chrono>
#include <set>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/fingerprint.hpp"
#include "apps/documents/json_difference.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/version.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

/// Data files of which the contents are part of a campaign's key: of as many groups of tasks at most.
constexpr std::int64_t most_groups_read = 1000;

/// Data files of the campaign's jobs, each once.
std::set<std::filesystem::path> data_files(const CampaignTasks& tasks) {
    std::set<std::filesystem::path> files;
    const std::int64_t replicates = tasks.campaign().replicates;
    const std::int64_t groups = std::min(tasks.count() / replicates, most_groups_read);
    for (std::int64_t group = 0; group < groups; ++group) {
        const JobReading reading = read_job(tasks.job_text(group * replicates), tasks.base(group * replicates).source);
        if (!reading.job) continue;
        for (const DataJob& data : reading.job->data) {
            if (data.file) files.insert(data.file->paths.begin(), data.file->paths.end());
            if (data.inputs && data.inputs->file) files.insert(*data.inputs->file);
        }
    }
    return files;
}

/// What decides the results: all but where the files are.
Json decisive(const CampaignTasks& tasks) {
    Json document = tasks.campaign().document();
    document.erase("title");
    for (Json& job : document["jobs"]) {
        job["job"] = json_value_or_discarded<Json>(job["text"].get<std::string>(), true);
        job.erase("text");
        job.erase("source");
    }
    return document;
}

JournalHead head_of(const CampaignTasks& tasks) {
    JournalHead head;
    const Campaign& campaign = tasks.campaign();
    head.title = campaign.title;
    head.kind = campaign_kind_names[static_cast<std::size_t>(campaign.kind)];
    head.document = campaign.document().dump(2) + "\n";
    head.key = campaign_key(tasks);
    head.version = program_version();
    head.created = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    head.tasks = tasks.count();
    head.varied = tasks.columns();
    return head;
}

}  // namespace

void add_missing_tasks(const CampaignTasks& tasks, Journal& journal) {
    if (journal.added() == tasks.count()) return;
    constexpr std::size_t at_once = 20'000;
    std::vector<TaskPlan> plans;
    for (const std::int64_t number : journal.missing()) {
        plans.push_back(tasks.plan(number));
        if (plans.size() < at_once) continue;
        journal.add_tasks(plans);
        plans.clear();
    }
    if (!plans.empty()) journal.add_tasks(plans);
}

namespace {

/// Where the campaign of a journal differs from this one.
std::string difference(const Journal& journal, const CampaignTasks& tasks) {
    const Json stored = Json::parse(journal.head().document, nullptr, false);
    if (!stored.is_object()) return "its campaign cannot be read";
    try {
        const CampaignTasks other(Campaign::from_document(stored));
        const std::string text = first_difference(decisive(other), decisive(tasks), "in this one");
        return text.empty() ? "a data file has changed since" : text;
    } catch (const std::exception& error) {
        return error.what();
    }
}

}  // namespace

std::string campaign_key(const CampaignTasks& tasks) {
    std::string text = decisive(tasks).dump();
    for (const auto& file : data_files(tasks))
        text += '\n' + sha256_of_file(file);
    return sha256(text);
}

Journal campaign_journal(const CampaignTasks& tasks, const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throw FileNotWritten(fmt::format("cannot create folder {}: {}", folder.string(), error.message()));
    const std::filesystem::path file = folder / journal_name;
    const JournalHead head = head_of(tasks);
    Journal journal =
        Journal::is_begun(file) ? Journal::open(file, Journal::Access::write) : Journal::create(file, head);
    remove_leftover_temporaries(folder);
    if (journal.head().key != head.key)
        throw OtherCampaign(fmt::format("{} holds the journal of another campaign ({}); choose another --out",
                                        folder.string(), difference(journal, tasks)));
    add_missing_tasks(tasks, journal);
    return journal;
}

bool run_campaign(const CampaignTasks& tasks, Journal& journal, const CampaignOptions& options,
                  const TaskRunner& runner, const DealerCalls& calls) {
    const auto waiting = static_cast<std::int64_t>(journal.waiting().size());
    const int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    const int wanted = options.ranks > 0 ? options.ranks : cores;
    const int computing = static_cast<int>(std::clamp<std::int64_t>(waiting, 1, wanted));
    std::unique_ptr<Crew> crew;
    if (options.given != nullptr && options.given->count() > 1)
        crew = given_crew(*options.given);
    else if (options.engine == Engine::threads || options.given != nullptr)
        crew = thread_crew(options.given != nullptr ? 1 : computing, runner);
    else
        crew = process_crew(computing, runner);
    Dealer dealer(tasks, journal, *crew, calls);
    return dealer.run();
}

}  // namespace orbid::apps
