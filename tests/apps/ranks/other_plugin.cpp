// A plug-in that another version of orbid was built with.
#include "apps/ranks/rank_plugin.hpp"

extern "C" __attribute__((visibility("default"))) const orbid::apps::RankPlugin* orbid_rank_plugin();
const orbid::apps::RankPlugin* orbid_rank_plugin() {
    static constexpr orbid::apps::RankPlugin plugin{orbid::apps::RankPlugin::current, "0.0.9", nullptr};
    return &plugin;
}
