"""The layout that drivestudio's preprocessing makes of Waymo, nuScenes, nuPlan, Argoverse 2, PandaSet and KITTI."""
